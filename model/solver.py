"""Eigenvalue problems of an assembled stack, set up once and solved for many parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as splinalg
from numpy.typing import NDArray

from model.chain import ChainFactor, factorize, levels
from model.eigen import lowest_modes
from model.mesh import FIELDS
from model.system import Assembly, Monomial, Target


@dataclass(frozen=True, eq=False, kw_only=True)
class Solver:
    """The mass and stiffness matrices of an assembly, ordered as a chain of blocks.

    Attributes
    ----------
    assembly : Assembly
        The equations of motion.
    groups : list of (n_i,) int
        Unknowns of each block of the chain.
    parts : tuple of (target, factor, matrix)
        Parts of M and K that share a factor, rows and columns in the order of `groups`.
    """

    assembly: Assembly
    groups: list[NDArray[np.intp]]
    parts: tuple[tuple[Target, Monomial, sp.csr_matrix], ...]

    def ordered_matrix(self, target: Target, theta: Mapping[str, float]) -> sp.csr_matrix:
        """Return M or K at the parameters `theta`, rows and columns in the order of `groups`."""
        found = [factor(theta) * matrix for part, factor, matrix in self.parts if part == target]
        return sum(found[1:], start=found[0])

    def factor(self, theta: Mapping[str, float], shift: float) -> ChainFactor:
        """Return the Cholesky factor of K + shift M.

        Raises
        ------
        SolveError
            The matrix is not positive definite.
        """
        matrix = self.ordered_matrix("K", theta) + shift * self.ordered_matrix("M", theta)
        return factorize(matrix, self.groups)

    def modes(
        self,
        theta: Mapping[str, float],
        shift: float,
        start: NDArray[np.float64],
        n_mode: int,
        tolerance: float,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the lowest eigenvalues, (n_mode,), and vectors, (size, n_mode); see `eigen.lowest_modes`."""
        mass = self.assembly.krons("M", theta)
        solve = self.factor(theta, shift).solve
        return lowest_modes(solve, lambda x: self.assembly.apply(mass, x), shift, start, n_mode, tolerance)


def prepare(assembly: Assembly, groups: list[NDArray[np.intp]]) -> Solver:
    """Assemble the parts of M and K that have a common factor, ordered by `groups`."""
    order = np.concatenate(groups)
    merged: dict[tuple[Target, tuple[tuple[str, int], ...]], list] = {}  # type: ignore[type-arg]
    for term in assembly.terms:
        if term.target != "C":
            key = (term.target, tuple(sorted(term.factor.exponent.items())))
            merged.setdefault(key, []).extend(term.krons)
    parts = tuple(
        (target, Monomial(exponent=dict(powers)), assembly.sparse_sum(tuple(krons))[order][:, order])
        for (target, powers), krons in merged.items()
    )
    return Solver(assembly=assembly, groups=groups, parts=parts)


def chain_over_plan(assembly: Assembly) -> list[NDArray[np.intp]]:
    """Group the unknowns from one end of the plan to the other."""
    plan = assembly.plan
    pattern = sp.block_array([[abs(plan.form(r, c)) for c in FIELDS] for r in FIELDS], format="csr")
    x = np.concatenate([plan.basis(field).doflocs[0] for field in FIELDS])
    start = np.flatnonzero(x <= x.min() + 1e-9 * np.ptp(x))
    sizes = np.cumsum([0, *(plan.size(field) for field in FIELDS)])
    where = assembly.slices()
    groups = []
    for level in levels(pattern, start):
        parts = []
        for i, field in enumerate(FIELDS):
            planar = level[(level >= sizes[i]) & (level < sizes[i + 1])] - sizes[i]
            over_z = np.arange(assembly.n_z[field]) * plan.size(field)
            parts.append((where[field].start + planar[:, None] + over_z).ravel())
        groups.append(np.concatenate(parts))
    return groups


def chain_over_laminas(assembly: Assembly) -> list[NDArray[np.intp]]:
    """Group the unknowns lamina by lamina."""
    where = assembly.slices()
    sizes = {field: assembly.plan.size(field) for field in FIELDS}
    return [
        np.concatenate([where[f].start + k * sizes[f] + np.arange(sizes[f]) for f in FIELDS])
        for k in range(assembly.n_z["w"])
    ]


def transfer(coarse: Assembly, fine: Assembly, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return displacements of one plan, (coarse.size, k), projected on another with the same functions of z."""
    y = np.zeros((fine.size, x.shape[1]))
    points = fine.plan.quadrature_points.reshape(2, -1).T
    for field, where in fine.slices().items():
        basis = fine.plan.basis(field)
        n_z, n_planar = fine.n_z[field], fine.plan.size(field)
        at_points = coarse.plan.point_rows(field, points)
        values = np.array([(shape[0].value * basis.dx).ravel() for shape in basis.basis])
        rows = np.repeat(basis.element_dofs, basis.dx.shape[1], axis=1)
        columns = np.broadcast_to(np.arange(values.shape[1]), values.shape)
        load = sp.coo_matrix(
            (values.ravel(), (rows.ravel(), columns.ravel())), (n_planar, values.shape[1])
        ).tocsr()
        solve = splinalg.factorized(fine.plan.form(field, field).tocsc())
        given = x[coarse.slices()[field]].reshape(n_z, coarse.plan.size(field), -1)
        moved = (load @ at_points) @ given.transpose(1, 0, 2).reshape(given.shape[1], -1)
        y[where] = solve(moved).reshape(n_planar, n_z, -1).transpose(1, 0, 2).reshape(n_z * n_planar, -1)
    return y
