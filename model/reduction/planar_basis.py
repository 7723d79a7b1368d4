"""A few shapes over the plan that stand for all its degrees of freedom, so that all laminas can be solved at once.

The shapes are drawn by proper orthogonal decomposition from modes of the stack itself, so they follow its outline with
teeth and slots, uneven pressure and clamps; a coarse mesh of such an outline would still have hundreds of elements.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from model.elements.equations import Assembly
from model.elements.mesh import FIELDS, Derivative, Field, Plan
from model.solvers.eigen import orthonormalize

Vector = NDArray[np.float64]

_LEFT_OUT = 1e-3  # size, relative to the first, of shapes that are left out
_LINEAR = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, eq=False, kw_only=True)
class ShapePlan(Plan):
    """A plan whose displacement fields are sums of a few shapes.

    Attributes
    ----------
    shape : mapping of field to (n, n_shape)
        Degrees of freedom of each shape in the spaces `membrane` and `plate`, orthonormal in the mass; linear
        functions are among them.
    """

    shape: Mapping[Field, Vector]

    @functools.cached_property
    def meshed(self) -> Plan:
        """The plan with all its degrees of freedom."""
        return Plan(membrane=self.membrane, plate=self.plate)

    def size(self, field: Field) -> int:
        """Return the number of shapes of a field."""
        return int(self.shape[field].shape[1])

    def elements(self, field: Field) -> sp.csr_matrix:
        """Return that every shape covers all of the plan, (size(field), 1)."""
        return sp.csr_matrix(np.ones((self.size(field), 1)))

    def abscissa(self, field: Field) -> Vector:
        """Return one place for all shapes, (size(field),) m."""
        return np.zeros(self.size(field))

    def form(
        self,
        row: Field,
        column: Field,
        derivatives: tuple[Derivative, Derivative] = ("", ""),
        weight: NDArray[np.float64] | float = 1.0,
    ) -> sp.csr_matrix:
        """Integrate the product of two fields' shapes, or of their derivatives, over the plan."""
        return self.projected(row, column, self.meshed.form(row, column, derivatives, weight))

    def interpolate(self, field: Field, linear: tuple[float, float, float]) -> Vector:
        """Return the shares of the shapes, (size(field),), in the linear function c0 + c1 x + c2 y."""
        return np.asarray(la.lstsq(self.shape[field], self.meshed.interpolate(field, linear))[0])

    def coordinates(self, field: Field, x: Vector) -> Vector:
        """Return the projection on the shapes of displacements (n, ...) of the meshed plan."""
        flat = self.meshed.form(field, field) @ x.reshape(x.shape[0], -1)
        return np.asarray(self.shape[field].T @ flat).reshape(-1, *x.shape[1:])

    def projected(self, row: Field, column: Field, planar: sp.csr_matrix) -> sp.csr_matrix:
        """Return a matrix of the meshed plan in the coordinates of the shapes, with every entry stored."""
        dense = self.shape[row].T @ (planar @ self.shape[column])
        n, m = dense.shape
        return sp.csr_matrix((dense.ravel(), np.tile(np.arange(m), n), m * np.arange(n + 1)), (n, m))


def leading_shapes(plan: Plan, samples: Mapping[Field, Vector]) -> ShapePlan:
    """Return the plan reduced to linear functions and the principal shapes of samples.

    Parameters
    ----------
    plan : Plan
        The meshed plan.
    samples : mapping of field to (plan.size(field), n)
        Displacements over the plan.
    """
    shape = {}
    for field in FIELDS:
        mass = plan.form(field, field)
        linear = np.column_stack([plan.interpolate(field, c) for c in _LINEAR])
        first, mass_first = orthonormalize(linear, lambda x, m=mass: m @ x)  # type: ignore[misc]
        rest = samples[field] - first @ (mass_first.T @ samples[field])
        gram = rest.T @ (mass @ rest)
        size, vectors = la.eigh((gram + gram.T) / 2.0)
        keep = size > _LEFT_OUT**2 * size[-1]
        shape[field] = np.hstack([first, rest @ (vectors[:, keep] / np.sqrt(size[keep]))])
    return ShapePlan(membrane=plan.membrane, plate=plan.plate, shape=shape)


def on_shapes(assembly: Assembly, plan: ShapePlan) -> Assembly:
    """Return the Galerkin projection of the equations of motion on the shapes of a plan."""
    terms = tuple(
        dataclasses.replace(
            term,
            krons=tuple(
                dataclasses.replace(kron, planar=plan.projected(kron.row, kron.column, kron.planar))
                for kron in term.krons
            ),
        )
        for term in assembly.terms
    )
    return dataclasses.replace(assembly, plan=plan, terms=terms)
