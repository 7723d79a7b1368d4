"""Eigenvalue problems of an assembled stack, set up once and solved for many parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as splinalg
from numpy.typing import NDArray

from model.chain import ChainFactor, factorize, levels
from model.eigen import lowest_modes
from model.mesh import FIELDS, Field
from model.system import Assembly, Monomial, Target

Vector = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, eq=False, kw_only=True)
class Group:
    """One block of the chain: for each field, all pairs of some indices over z and some over the plan."""

    z: Mapping[Field, Index]
    planar: Mapping[Field, Index]

    def size(self, field: Field) -> int:
        """Return the number of unknowns of a field."""
        return self.z[field].size * self.planar[field].size

    def unknowns(self, assembly: Assembly) -> Index:
        """Return the places of the block's unknowns in a displacement vector, planar index outside."""
        where = assembly.slices()
        return np.concatenate(
            [
                (where[f].start + self.planar[f][:, None] + self.z[f] * assembly.plan.size(f)).ravel()
                for f in FIELDS
            ]
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Coupling:
    """All Kronecker products that couple two fields, with their planar matrices on one common pattern.

    Attributes
    ----------
    row, column : "u", "v" or "w"
        The fields.
    rows, columns : (n_entry,) int
        The pattern.
    values : (n_entry, n_product)
        Entries of each product's planar matrix.
    z : (n_product, n_z_row, n_z_column)
        Its matrix over z.
    target : tuple of "M" or "K"
        The matrix that it is part of.
    factor : tuple of Monomial
        Its factor.
    """

    row: Field
    column: Field
    rows: Index
    columns: Index
    values: Vector
    z: Vector
    target: tuple[Target, ...]
    factor: tuple[Monomial, ...]

    def weighted_z(self, theta: Mapping[str, float], shift: float) -> Vector:
        """Return the matrices over z with their share in K + shift M, (n_product, n_z_row, n_z_column)."""
        share = [
            factor(theta) * (shift if target == "M" else 1.0)
            for target, factor in zip(self.target, self.factor, strict=True)
        ]
        return np.asarray(self.z * np.array(share)[:, None, None])


def couplings(assembly: Assembly) -> tuple[Coupling, ...]:
    """Return the mass and stiffness matrices sorted by the fields that they couple, in both orders."""
    found: dict[tuple[Field, Field], list] = {}  # type: ignore[type-arg]
    for term in assembly.terms:
        if term.target == "C":
            continue
        for kron in term.krons:
            entry = (kron.planar.tocsr(), kron.z, term.target, term.factor)
            found.setdefault((kron.row, kron.column), []).append(entry)
    result = []
    for (row, column), entries in found.items():
        size = assembly.plan.size(column)
        keys = []
        for planar, *_ in entries:
            coo = planar.tocoo()
            keys.append(coo.row.astype(np.int64) * size + coo.col)
        pattern = np.unique(np.concatenate(keys))
        values = np.zeros((pattern.size, len(entries)))
        for i, (planar, *_) in enumerate(entries):
            values[np.searchsorted(pattern, keys[i]), i] = planar.tocoo().data
        z = np.array([e[1].toarray() if sp.issparse(e[1]) else e[1] for e in entries])
        targets, factors = tuple(e[2] for e in entries), tuple(e[3] for e in entries)
        rows, columns = np.divmod(pattern, size)
        result.append(
            Coupling(
                row=row,
                column=column,
                rows=rows,
                columns=columns,
                values=values,
                z=z,
                target=targets,
                factor=factors,
            )
        )
        if row != column:
            result.append(
                Coupling(
                    row=column,
                    column=row,
                    rows=columns,
                    columns=rows,
                    values=values,
                    z=z.transpose(0, 2, 1),
                    target=targets,
                    factor=factors,
                )
            )
    return tuple(result)


@dataclass(frozen=True, eq=False, kw_only=True)
class Solver:
    """The mass and stiffness matrices of an assembly, cut into a chain of blocks.

    Attributes
    ----------
    assembly : Assembly
        The equations of motion.
    groups : tuple of Group
        The blocks.
    couplings : tuple of Coupling
        The matrices.
    """

    assembly: Assembly
    groups: tuple[Group, ...]
    couplings: tuple[Coupling, ...]

    def columns(self, theta: Mapping[str, float], shift: float) -> Iterator[Vector]:
        """Yield, block by block, the columns of K + shift M from the diagonal block down."""
        weighted = [c.weighted_z(theta, shift) for c in self.couplings]
        for i, group in enumerate(self.groups):
            parts = [self._block(group, group, weighted)]
            if i + 1 < len(self.groups):
                parts.append(self._block(self.groups[i + 1], group, weighted))
            yield np.vstack(parts)

    def _block(self, below: Group, group: Group, weighted: list[Vector]) -> Vector:
        row_ends = np.cumsum([0, *(below.size(f) for f in FIELDS)])
        column_ends = np.cumsum([0, *(group.size(f) for f in FIELDS)])
        block = np.zeros((row_ends[-1], column_ends[-1]))
        for coupling, z in zip(self.couplings, weighted, strict=True):
            r, c = FIELDS.index(coupling.row), FIELDS.index(coupling.column)
            i = _positions(below.planar[coupling.row], self.assembly.plan.size(coupling.row))[coupling.rows]
            j = _positions(group.planar[coupling.column], self.assembly.plan.size(coupling.column))[
                coupling.columns
            ]
            inside = np.flatnonzero((i >= 0) & (j >= 0))
            z_rows, z_columns = below.z[coupling.row], group.z[coupling.column]
            z_part = z[:, z_rows[:, None], z_columns]
            entries = coupling.values[inside] @ z_part.reshape(z_part.shape[0], -1)
            view = np.zeros(
                (
                    below.planar[coupling.row].size,
                    z_rows.size,
                    group.planar[coupling.column].size,
                    z_columns.size,
                )
            )
            view[i[inside], :, j[inside], :] = entries.reshape(-1, z_rows.size, z_columns.size)
            block[row_ends[r] : row_ends[r + 1], column_ends[c] : column_ends[c + 1]] = view.reshape(
                below.size(coupling.row), group.size(coupling.column)
            )
        return block

    def factor(self, theta: Mapping[str, float], shift: float) -> ChainFactor:
        """Return the Cholesky factor of K + shift M.

        Raises
        ------
        SolveError
            The matrix is not positive definite.
        """
        return factorize(self.columns(theta, shift), [g.unknowns(self.assembly) for g in self.groups])

    def modes(
        self,
        theta: Mapping[str, float],
        shift: float,
        start: Vector,
        n_mode: int,
        tolerance: float,
    ) -> tuple[Vector, Vector]:
        """Return the lowest eigenvalues, (n_mode,), and vectors, (size, k); see `eigen.lowest_modes`."""
        mass = self.assembly.krons("M", theta)
        solve = self.factor(theta, shift).solve
        return lowest_modes(solve, lambda x: self.assembly.apply(mass, x), shift, start, n_mode, tolerance)


def _positions(members: Index, size: int) -> Index:
    """Return the place of each index in `members`, or -1 where it is not among them."""
    positions = np.full(size, -1)
    positions[members] = np.arange(members.size)
    return positions


def solver_over_plan(assembly: Assembly) -> Solver:
    """Cut the equations into blocks from one end of the plan to the other, each with all functions of z."""
    plan = assembly.plan
    parts = couplings(assembly)
    ends = np.cumsum([0, *(plan.size(field) for field in FIELDS)])
    offset = dict(zip(FIELDS, ends, strict=False))
    rows = np.concatenate([part.rows + offset[part.row] for part in parts])
    columns = np.concatenate([part.columns + offset[part.column] for part in parts])
    pattern = sp.coo_matrix((np.ones(rows.size), (rows, columns)), (ends[-1], ends[-1])).tocsr()
    x = np.concatenate([plan.basis(field).doflocs[0] for field in FIELDS])
    start = np.flatnonzero(x <= x.min() + 1e-9 * np.ptp(x))
    z = {field: np.arange(assembly.n_z[field]) for field in FIELDS}
    groups = tuple(
        Group(
            z=z,
            planar={
                field: level[(level >= ends[i]) & (level < ends[i + 1])] - ends[i]
                for i, field in enumerate(FIELDS)
            },
        )
        for level in levels(pattern, start)
    )
    return Solver(assembly=assembly, groups=groups, couplings=parts)


def solver_over_laminas(assembly: Assembly) -> Solver:
    """Cut the equations of all laminas into blocks of one lamina each."""
    planar = {field: np.arange(assembly.plan.size(field)) for field in FIELDS}
    groups = tuple(
        Group(z=dict.fromkeys(FIELDS, np.array([k])), planar=planar) for k in range(assembly.n_z["w"])
    )
    return Solver(assembly=assembly, groups=groups, couplings=couplings(assembly))


def transfer(coarse: Assembly, fine: Assembly, x: Vector) -> Vector:
    """Return displacements of one plan, (coarse.size, k), projected on a finer one, (fine.size, k)."""
    y = np.zeros((fine.size, x.shape[1]))
    points = fine.plan.quadrature_points.reshape(2, -1).T
    for field, where in fine.slices().items():
        basis = fine.plan.basis(field)
        n_z, n_planar = fine.n_z[field], fine.plan.size(field)
        at_points = coarse.plan.point_rows(field, points)
        values = np.array([(np.asarray(shape[0]) * basis.dx).ravel() for shape in basis.basis])
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
