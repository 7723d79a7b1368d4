"""Eigenvalue problems of an assembled stack, set up once and solved for many parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as splinalg
from numpy.typing import NDArray

from model.chain import factorize, levels
from model.eigen import Block, lowest_modes
from model.low_rank import Factor, LowRank, low_rank, with_change
from model.mesh import FIELDS, Field
from model.system import Assembly, Kron, ParameterFactor, Target, Term

Vector = NDArray[np.float64]
Index = NDArray[np.intp]

_UNCOUPLED = 1e-12  # of a matrix's largest entry over z: below it, a coupling of two functions is rounding


@dataclass(frozen=True, eq=False, kw_only=True)
class Group:
    """One block of the chain: for each field, all pairs of some indices over z and some over the plan.

    Attributes
    ----------
    z : mapping of field to (n,) int
        Indices over z.
    planar : mapping of field to (m,) int
        Indices over the plan.
    level : int
        Which of the planar groups it is; `Coupling.entries` are sorted by them.
    linked : bool
        Whether the next group of the chain is coupled to this one.
    """

    z: Mapping[Field, Index]
    planar: Mapping[Field, Index]
    level: int
    linked: bool

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
    z : (n_product, n_z_row, n_z_column)
        Each product's matrix over z.
    target : tuple of "M" or "K"
        The matrix that it is part of.
    factor : tuple of ParameterFactor
        Its factor.
    entries : mapping of (level, level) to ((n,) int, (n,) int, (n, n_product))
        For each pair of planar groups, rows and columns within them and the planar matrices' values there.
    """

    row: Field
    column: Field
    z: Vector
    target: tuple[Target, ...]
    factor: tuple[ParameterFactor, ...]
    entries: Mapping[tuple[int, int], tuple[Index, Index, Vector]]

    def weighted_z(self, theta: Mapping[str, float], shift: float) -> Vector:
        """Return the matrices over z with their share in K + shift M, (n_product, n_z_row, n_z_column)."""
        share = [
            factor(theta) * (shift if target == "M" else 1.0)
            for target, factor in zip(self.target, self.factor, strict=True)
        ]
        return np.asarray(self.z * np.array(share)[:, None, None])


def _couplings(
    assembly: Assembly, products: list[tuple[Term, Kron]], planar_groups: list[Mapping[Field, Index]]
) -> tuple[Coupling, ...]:
    """Sort products by the fields that they couple, in both orders, and by the planar groups."""
    level, place = {}, {}
    for field in FIELDS:
        level[field], place[field] = np.zeros((2, assembly.plan.size(field)), dtype=np.intp)
        for i, group in enumerate(planar_groups):
            level[field][group[field]] = i
            place[field][group[field]] = np.arange(group[field].size)

    found: dict[tuple[Field, Field], list[tuple[Term, Kron]]] = {}
    for term, kron in products:
        found.setdefault((kron.row, kron.column), []).append((term, kron))
        if kron.row != kron.column:
            turned = Kron(row=kron.column, column=kron.row, z=kron.z.T, planar=kron.planar.T.tocsr())
            found.setdefault((kron.column, kron.row), []).append((term, turned))
    result = []
    for (row, column), own in found.items():
        size = assembly.plan.size(column)
        entries = [kron.planar.tocoo() for _, kron in own]
        keys = [coo.row.astype(np.int64) * size + coo.col for coo in entries]
        pattern = np.unique(np.concatenate(keys))
        values = np.zeros((pattern.size, len(own)))
        for i, (key, coo) in enumerate(zip(keys, entries, strict=True)):
            np.add.at(values[:, i], np.searchsorted(pattern, key), coo.data)
        rows, columns = np.divmod(pattern, size)
        pair = level[row][rows] * len(planar_groups) + level[column][columns]
        order = np.argsort(pair, kind="stable")
        pairs, first = np.unique(pair[order], return_index=True)
        members = dict(zip(pairs.tolist(), np.split(order, first[1:]), strict=True))
        result.append(
            Coupling(
                row=row,
                column=column,
                z=np.array([k.z.toarray() if sp.issparse(k.z) else k.z for _, k in own]),
                target=tuple(term.target for term, _ in own),
                factor=tuple(term.factor for term, _ in own),
                entries={
                    divmod(p, len(planar_groups)): (place[row][rows[m]], place[column][columns[m]], values[m])
                    for p, m in members.items()
                },
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
        The matrices, without what couples blocks that are not neighbours.
    far : tuple of (Term, Kron)
        The products that do so.
    change : LowRank
        The space in which they act.
    """

    assembly: Assembly
    groups: tuple[Group, ...]
    couplings: tuple[Coupling, ...]
    far: tuple[tuple[Term, Kron], ...]
    change: LowRank

    def columns(self, theta: Mapping[str, float], shift: float) -> Iterator[Vector]:
        """Yield, block by block, the columns of K + shift M from the diagonal block down."""
        weighted = [c.weighted_z(theta, shift) for c in self.couplings]
        for i, group in enumerate(self.groups):
            parts = [self._block(group, group, weighted)]
            if group.linked:
                parts.append(self._block(self.groups[i + 1], group, weighted))
            yield np.vstack(parts)

    def _block(self, below: Group, group: Group, weighted: list[Vector]) -> Vector:
        row_ends = np.cumsum([0, *(below.size(f) for f in FIELDS)])
        column_ends = np.cumsum([0, *(group.size(f) for f in FIELDS)])
        block = np.zeros((row_ends[-1], column_ends[-1]))
        for coupling, z in zip(self.couplings, weighted, strict=True):
            if (below.level, group.level) not in coupling.entries:
                continue
            i, j, values = coupling.entries[below.level, group.level]
            r, c = FIELDS.index(coupling.row), FIELDS.index(coupling.column)
            z_rows, z_columns = below.z[coupling.row], group.z[coupling.column]
            if not z_rows.size * z_columns.size:
                continue
            z_part = z[:, z_rows[:, None], z_columns]
            size = (below.planar[coupling.row].size, group.planar[coupling.column].size)
            part = np.zeros((size[0], z_rows.size, size[1], z_columns.size))
            entries = values @ z_part.reshape(z_part.shape[0], -1)
            part[i, :, j, :] = entries.reshape(-1, z_rows.size, z_columns.size)
            block[row_ends[r] : row_ends[r + 1], column_ends[c] : column_ends[c + 1]] = part.reshape(
                below.size(coupling.row), group.size(coupling.column)
            )
        return block

    def factor(self, theta: Mapping[str, float], shift: float) -> Factor:
        """Return the factor of K + shift M.

        Raises
        ------
        SolveError
            The matrix is not positive definite.
        """
        chain = factorize(self.columns(theta, shift), [g.unknowns(self.assembly) for g in self.groups])
        shares = [term.factor(theta) * (shift if term.target == "M" else 1.0) for term, _ in self.far]
        krons = tuple(
            Kron(row=kron.row, column=kron.column, z=share * kron.z, planar=kron.planar)
            for share, (_, kron) in zip(shares, self.far, strict=True)
        )
        return with_change(chain, self.change, self.change.core(krons))

    def modes(
        self,
        theta: Mapping[str, float],
        shift: float,
        start: Vector,
        n_mode: int,
        tolerance: float,
        known: Sequence[Block] = (),
    ) -> tuple[Vector, Vector]:
        """Return the lowest eigenvalues, (n_mode,), and vectors, (size, k); see `eigen.lowest_modes`."""
        mass = self.assembly.krons("M", theta)
        solve = self.factor(theta, shift).solve
        return lowest_modes(
            solve, lambda x: self.assembly.apply(mass, x), shift, start, n_mode, tolerance, known
        )


def _solver(
    assembly: Assembly,
    groups: tuple[Group, ...],
    planar_groups: list[Mapping[Field, Index]],
    is_near: Callable[[Kron], bool],
) -> Solver:
    products = [(term, kron) for term in assembly.terms if term.target != "C" for kron in term.krons]
    near = [is_near(kron) for _, kron in products]
    far = tuple(product for product, ok in zip(products, near, strict=True) if not ok)
    return Solver(
        assembly=assembly,
        groups=groups,
        couplings=_couplings(
            assembly, [p for p, ok in zip(products, near, strict=True) if ok], planar_groups
        ),
        far=far,
        change=low_rank(assembly, tuple(kron for _, kron in far)),
    )


def solver_over_plan(assembly: Assembly) -> Solver:
    """Cut the equations into blocks from one end of the plan to the other, each with all functions of z.

    Functions of z that no term couples, such as the even and the odd ones of a stack that is symmetric about
    its middle, form chains of their own.
    """
    plan = assembly.plan
    ends = np.cumsum([0, *(plan.size(field) for field in FIELDS)])
    shares = {(r, c): _elements(plan.basis(r)) @ _elements(plan.basis(c)).T for r in FIELDS for c in FIELDS}
    pattern = sp.vstack([sp.hstack([shares[r, c] for c in FIELDS]) for r in FIELDS]).tocsr()
    x = np.concatenate([plan.basis(field).doflocs[0] for field in FIELDS])
    start = np.flatnonzero(x <= x.min() + 1e-9 * np.ptp(x))
    planar_groups: list[Mapping[Field, Index]] = [
        {field: level[(level >= ends[i]) & (level < ends[i + 1])] - ends[i] for i, field in enumerate(FIELDS)}
        for level in levels(pattern, start)
    ]
    groups = tuple(
        Group(z=z, planar=planar, level=i, linked=i + 1 < len(planar_groups))
        for z in _uncoupled_functions(assembly)
        for i, planar in enumerate(planar_groups)
    )

    def is_near(kron: Kron) -> bool:
        there = kron.planar.astype(bool)
        return bool((there > there.multiply(shares[kron.row, kron.column].astype(bool))).nnz == 0)

    return _solver(assembly, groups, planar_groups, is_near)


def _elements(basis: object) -> sp.csr_matrix:
    """Return which element holds which degree of freedom of a skfem basis, (n_dof, n_element)."""
    dofs = basis.element_dofs  # type: ignore[attr-defined]
    columns = np.broadcast_to(np.arange(dofs.shape[1]), dofs.shape)
    return sp.coo_matrix((np.ones(dofs.size), (dofs.ravel(), columns.ravel()))).tocsr()


def _uncoupled_functions(assembly: Assembly) -> list[dict[Field, Index]]:
    """Return the sets of functions of z, for each field, of which no term couples one to another."""
    ends = np.cumsum([0, *(assembly.n_z[field] for field in FIELDS)])
    linked = sp.csr_matrix((ends[-1], ends[-1]))
    for term in assembly.terms:
        if term.target == "C":
            continue
        for kron in term.krons:
            size = abs(sp.csr_matrix(kron.z))
            r, c = FIELDS.index(kron.row), FIELDS.index(kron.column)
            coo = (size > _UNCOUPLED * size.max()).tocoo()
            linked += sp.coo_matrix((np.ones(coo.nnz), (coo.row + ends[r], coo.col + ends[c])), linked.shape)
    count, label = sp.csgraph.connected_components(linked, directed=False)
    return [
        {field: np.flatnonzero(label[ends[i] : ends[i + 1]] == part) for i, field in enumerate(FIELDS)}
        for part in range(count)
    ]


def solver_over_laminas(assembly: Assembly) -> Solver:
    """Cut the equations of all laminas into blocks of one lamina each."""
    planar: Mapping[Field, Index] = {field: np.arange(assembly.plan.size(field)) for field in FIELDS}
    n_lamina = assembly.n_z["w"]
    groups = tuple(
        Group(z=dict.fromkeys(FIELDS, np.array([k])), planar=planar, level=0, linked=k + 1 < n_lamina)
        for k in range(n_lamina)
    )

    def is_near(kron: Kron) -> bool:
        z = sp.coo_matrix(kron.z)
        return bool(np.all(np.abs(z.row - z.col)[z.data != 0.0] <= 1))

    return _solver(assembly, groups, [planar], is_near)


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
