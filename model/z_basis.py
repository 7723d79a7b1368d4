"""Functions of z: a few displacement profiles over the height that stand for all laminas.

They are drawn by proper orthogonal decomposition from the modes of a coarse plan with all laminas and all
interfaces, so weak interfaces, uneven pressure and masses on the faces shape them. Polynomials alone do not
do: the membrane stress has thin layers at both faces, and a weak interface is a jump.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from model.assemble import assemble
from model.mesh import FIELDS, Field
from model.solver import chain_over_laminas, prepare
from model.stack import Mesh, Stack
from model.system import Assembly

COARSE = Mesh(n_x=4, n_y=2)
SPARE = 6  # vectors iterated beyond the modes asked for, so that the last ones converge as fast as the first
_TOLERANCE = 1e-5  # of the coarse modes: they give directions, not values


@dataclass(frozen=True, eq=False, kw_only=True)
class ZBasis:
    """Functions of z and the coarse modes that they were drawn from.

    Attributes
    ----------
    phi : mapping of field to (n_lamina, n_function)
        Orthonormal columns. Uniform and linear displacement over z are among those of u and v, uniform
        displacement among those of w, so rigid-body modes are exact.
    coarse : Assembly
        The coarse plan's equations of motion, reduced by `phi`.
    snapshots : tuple of (coarse.size, n_vector)
        The coarse modes in that reduction, one array for each value of G_f.
    """

    phi: Mapping[Field, NDArray[np.float64]]
    coarse: Assembly
    snapshots: tuple[NDArray[np.float64], ...]


def shear_shift(stack: Stack, theta: Mapping[str, float]) -> float:
    """Return the squared angular frequency, (rad/s)**2, at which half a shear wave fits the stack's length."""
    shear = theta["G_f"] * stack.contact.pressure
    return float(shear / (theta["density"] * stack.material.density) * (np.pi / stack.length) ** 2)


def _principal_functions(
    values: Sequence[NDArray[np.float64]],
    weight: sp.csr_matrix,
    first: NDArray[np.float64],
    n_function: int,
) -> NDArray[np.float64]:
    """Return orthonormal functions of z: `first`, then those that carry most of what remains of `values`.

    Parameters
    ----------
    values : sequence of (n_lamina, n_planar, n_mode)
        Fields to represent.
    weight : (n_planar, n_planar)
        Planar mass form, which makes the products integrals over the plan.
    first : (n_lamina, m)
        Functions that must be in the span.
    n_function : int
        Total number of functions.
    """
    n_function = min(n_function, first.shape[0])
    basis = la.qr(first, mode="economic")[0][:, :n_function]
    gram = np.zeros((first.shape[0], first.shape[0]))
    for value in values:
        plain = value.transpose(1, 0, 2)
        weighted = (weight @ plain.reshape(plain.shape[0], -1)).reshape(plain.shape)
        gram += np.tensordot(plain, weighted, axes=([0, 2], [0, 2]))
    gram -= basis @ (basis.T @ gram)
    gram -= (gram @ basis) @ basis.T
    vectors = la.eigh((gram + gram.T) / 2.0)[1][:, ::-1]
    extra = n_function - basis.shape[1]
    return np.asarray(la.qr(np.hstack([basis, vectors[:, :extra]]), mode="economic")[0])


def z_basis(stack: Stack, G_f: Sequence[float], n_mode: int, n_membrane: int, n_bending: int) -> ZBasis:
    """Draw functions of z from the modes of a coarse plan.

    Parameters
    ----------
    stack : Stack
        The stack; its mesh is replaced by 4 x 2 elements.
    G_f : sequence of float
        Contact stiffness parameters at which the modes are taken.
    n_mode : int
        Number of modes for each.
    n_membrane, n_bending : int
        Number of functions for u and v, and for w.
    """
    full = assemble(dataclasses.replace(stack, mesh=COARSE))
    solver = prepare(full, chain_over_laminas(full))
    start = np.random.default_rng(0).standard_normal((full.size, n_mode + SPARE))
    snapshots = []
    for value in G_f:
        theta = {**full.theta, "G_f": value}
        _, start = solver.modes(theta, shear_shift(stack, theta), start, n_mode, _TOLERANCE)
        snapshots.append(start)
    where, n = full.slices(), stack.n_lamina

    def parts(field: Field) -> list[NDArray[np.float64]]:
        return [s[where[field]].reshape(n, -1, s.shape[1]) for s in snapshots]

    rigid = np.column_stack([np.ones(n), stack.lamina_z])
    membrane = _principal_functions(parts("u") + parts("v"), full.plan.form("u", "u"), rigid, n_membrane)
    bending = _principal_functions(parts("w"), full.plan.form("w", "w"), rigid[:, :1], n_bending)
    phi: dict[Field, NDArray[np.float64]] = {"u": membrane, "v": membrane, "w": bending}
    reduced = tuple(
        np.vstack([(phi[f].T @ s[where[f]].reshape(n, -1)).reshape(-1, s.shape[1]) for f in FIELDS])
        for s in snapshots
    )
    return ZBasis(phi=phi, coarse=full.project_z(phi), snapshots=reduced)
