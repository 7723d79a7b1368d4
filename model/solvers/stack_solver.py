"""Eigenvalue problems of an assembled stack, set up once and solved for many parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from lamella_shared import Reals
from model.elements.equations import Assembly, Kron, ParameterFactor, Target, Term
from model.elements.mesh import FIELDS, Field
from model.solvers.eigen import Block, lowest_modes, orthonormalize
from model.solvers.low_rank import Factor, FarProduct, LowRank, factorize, levels, low_rank, with_change

Index = NDArray[np.intp]


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
    n_coupled : mapping of field to int
        How many of the planar indices are coupled to the next group: the last ones.
    """

    z: Mapping[Field, Index]
    planar: Mapping[Field, Index]
    level: int
    n_coupled: Mapping[Field, int]

    @property
    def n_free(self) -> int:
        """Number of unknowns that are not coupled to the next group; they come first."""
        return sum(self.z[f].size * (self.planar[f].size - self.n_coupled[f]) for f in FIELDS)

    @property
    def total(self) -> int:
        """Number of unknowns."""
        return sum(self.z[f].size * self.planar[f].size for f in FIELDS)

    def places(self) -> dict[Field, Index]:
        """Return where in the block the unknowns of each planar index begin, one for each index over z."""
        free, coupled, found = 0, self.n_free, {}
        for f in FIELDS:
            n_z, n_coupled = self.z[f].size, self.n_coupled[f]
            n_free = self.planar[f].size - n_coupled
            found[f] = np.concatenate([free + n_z * np.arange(n_free), coupled + n_z * np.arange(n_coupled)]).astype(
                np.intp
            )
            free, coupled = free + n_z * n_free, coupled + n_z * n_coupled
        return found

    def unknowns(self, assembly: Assembly) -> Index:
        """Return the places of the block's unknowns in a displacement vector."""
        where, result = assembly.slices(), np.empty(self.total, dtype=np.intp)
        for f, places in self.places().items():
            in_vector = where[f].start + self.planar[f][:, None] + self.z[f] * assembly.plan.size(f)
            result[places[:, None] + np.arange(self.z[f].size)] = in_vector
        return result


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
    z: Reals
    target: tuple[Target, ...]
    factor: tuple[ParameterFactor, ...]
    entries: Mapping[tuple[int, int], tuple[Index, Index, Reals]]

    def weighted_z(self, theta: Mapping[str, float], shift: float) -> Reals:
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
    for (row, column), coupled in found.items():
        size = assembly.plan.size(column)
        entries = [kron.planar.tocoo() for _, kron in coupled]
        keys = [coo.row.astype(np.int64) * size + coo.col for coo in entries]
        pattern = np.unique(np.concatenate(keys))
        values = np.zeros((pattern.size, len(coupled)))
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
                z=np.array([k.z.toarray() if sp.issparse(k.z) else k.z for _, k in coupled]),
                target=tuple(term.target for term, _ in coupled),
                factor=tuple(term.factor for term, _ in coupled),
                entries={
                    divmod(p, len(planar_groups)): (place[row][rows[m]], place[column][columns[m]], values[m])
                    for p, m in members.items()
                },
            )
        )
    return tuple(result)


@dataclass(frozen=True, eq=False, kw_only=True)
class Chain:
    """Some of the through-thickness functions, which no term couples to others, with all of the plan.

    Attributes
    ----------
    groups : tuple of Group
        The blocks.
    """

    groups: tuple[Group, ...]

    @property
    def members(self) -> dict[Field, Index]:
        """The indices over z of each field."""
        return {f: np.unique(np.concatenate([group.z[f] for group in self.groups])) for f in FIELDS}


@dataclass(frozen=True, eq=False, kw_only=True)
class Solver:
    """The mass and stiffness matrices of an assembly, cut into chains of blocks.

    Attributes
    ----------
    assembly : Assembly
        The equations of motion.
    chains : tuple of Chain
        Independent parts of the equations.
    couplings : tuple of Coupling
        The matrices, without what couples blocks that are not neighbours.
    far : tuple of FarProduct
        The products that do so.
    """

    assembly: Assembly
    chains: tuple[Chain, ...]
    couplings: tuple[Coupling, ...]
    far: tuple[FarProduct, ...]
    _spaces: dict[tuple[int, ...], tuple[LowRank, ...]] = dataclasses.field(
        default_factory=dict, init=False, repr=False
    )

    def _columns(self, groups: tuple[Group, ...], weighted: list[Reals]) -> Iterator[tuple[Reals, Reals]]:
        """Yield each diagonal block and its coupling to the next block as `factorize` wants them."""
        for i, group in enumerate(groups):
            last = i + 1 == len(groups)
            yield (
                self._block(group, group, weighted),
                np.zeros((0, 0)) if last else self._block(group, groups[i + 1], weighted)[group.n_free :],
            )

    def _block(self, group: Group, right: Group, weighted: list[Reals]) -> Reals:
        """Return rows of one group, columns of another."""
        block = np.zeros((group.total, right.total))
        row_places, column_places = group.places(), right.places()
        for coupling, z in zip(self.couplings, weighted, strict=True):
            rows, columns = group.z[coupling.row], right.z[coupling.column]
            if (group.level, right.level) not in coupling.entries or not rows.size * columns.size:
                continue
            i, j, values = coupling.entries[group.level, right.level]
            z_part = z[:, rows[:, None], columns]
            entries = (values @ z_part.reshape(z_part.shape[0], -1)).reshape(-1, rows.size, columns.size)
            at = row_places[coupling.row][i][:, None, None] + np.arange(rows.size)[:, None]
            to = column_places[coupling.column][j][:, None, None] + np.arange(columns.size)
            block[at, to] = entries
        return block

    def factor(self, theta: Mapping[str, float], shift: float) -> Factor:
        """Return the factor of K + shift M.

        Raises
        ------
        SolveError
            The matrix is not positive definite.
        """
        weighted = [c.weighted_z(theta, shift) for c in self.couplings]
        shares = [p.term.factor(theta) * (shift if p.term.target == "M" else 1.0) for p in self.far]
        acting = tuple(i for i, share in enumerate(shares) if share != 0.0)
        away = [self.far[i] for i in acting]
        far = tuple(dataclasses.replace(p.kron, z=shares[i] * p.kron.z) for i, p in zip(acting, away, strict=True))
        if acting not in self._spaces:
            self._spaces[acting] = tuple(low_rank(self.assembly, away, c.members) for c in self.chains)
        parts = []
        for chain, change in zip(self.chains, self._spaces[acting], strict=True):
            rows = np.concatenate([group.unknowns(self.assembly) for group in chain.groups])
            factor = factorize(self._columns(chain.groups, weighted))
            parts.append(with_change(factor, rows, change, change.core(far)))
        return Factor(parts=tuple(parts))

    def modes(
        self,
        theta: Mapping[str, float],
        shift: float,
        start: Reals,
        n_mode: int,
        tolerance: float,
        rigid: Reals | None = None,
        min_steps: int = 2,
    ) -> tuple[Reals, Reals]:
        """Return the lowest eigenvalues and vectors of the equations of motion.

        Parameters
        ----------
        theta : mapping of str to float
            Parameters.
        shift, start, n_mode, tolerance, min_steps
            As in `eigen.lowest_modes`.
        rigid : (size, m), optional
            Rigid-body motion. Where it costs no energy it is taken as m modes found, of eigenvalue 0, and the
            iteration spares them.

        Returns
        -------
        eigenvalue : (n_mode,)
            Ascending, (rad/s)**2.
        vector : (size, k)
            Mass-normalised; k is at least `n_mode`.
        """
        free = 1e-8  # of the shift: energy of rigid-body motion below it is rounding
        mass, stiffness = (self.assembly.krons(target, theta) for target in ("M", "K"))

        def product(x: Reals) -> Reals:
            return self.assembly.apply(mass, x)

        known: list[Block] = []
        if rigid is not None:
            block = orthonormalize(rigid, product)
            energy = np.einsum("ij,ij->j", block[0], self.assembly.apply(stiffness, block[0]))
            known = [block] if np.all(np.abs(energy) < free * shift) else []
            start = start if known else np.hstack([rigid, start])
        n_known = sum(basis.shape[1] for basis, _ in known)
        solve = self.factor(theta, shift).solve
        values, vectors = lowest_modes(solve, product, shift, start, n_mode - n_known, tolerance, known, min_steps)
        return np.concatenate([np.zeros(n_known), values]), np.hstack([*(basis for basis, _ in known), vectors])


def _solver(
    assembly: Assembly,
    chains: list[tuple[Group, ...]],
    planar_groups: list[Mapping[Field, Index]],
    is_near: Callable[[Kron], bool],
) -> Solver:
    products = [(term, kron) for term in assembly.terms if term.target != "C" for kron in term.krons]
    near = [is_near(kron) for _, kron in products]
    far = tuple(FarProduct.of(*product) for product, ok in zip(products, near, strict=True) if not ok)
    return Solver(
        assembly=assembly,
        chains=tuple(Chain(groups=groups) for groups in chains),
        couplings=_couplings(assembly, [p for p, ok in zip(products, near, strict=True) if ok], planar_groups),
        far=far,
    )


def solver_over_plan(assembly: Assembly) -> Solver:
    """Cut the equations into blocks from one end of the plan to the other, each with all through-thickness functions.

    Through-thickness functions that no term couples, such as the even and the odd ones of a stack that is symmetric
    about its middle, form chains of their own.
    """
    plan = assembly.plan
    ends = np.cumsum([0, *(plan.size(field) for field in FIELDS)])
    elements = {f: plan.elements(f) for f in FIELDS}
    shares = {(r, c): elements[r] @ elements[c].T for r in FIELDS for c in FIELDS}
    pattern = sp.vstack([sp.hstack([shares[r, c] for c in FIELDS]) for r in FIELDS]).tocsr()
    x = np.concatenate([plan.abscissa(field) for field in FIELDS])
    start = np.flatnonzero(x <= x.min() + 1e-9 * np.ptp(x))
    planar_groups: list[Mapping[Field, Index]] = [
        {field: level[(level >= ends[i]) & (level < ends[i + 1])] - ends[i] for i, field in enumerate(FIELDS)}
        for level in levels(pattern, start)
    ]
    level = {f: np.zeros(plan.size(f), dtype=np.intp) for f in FIELDS}
    for i, group in enumerate(planar_groups):
        for f in FIELDS:
            level[f][group[f]] = i
    n_coupled: list[Mapping[Field, int]] = [
        {f: int(np.count_nonzero(sum(shares[f, g][group[f]] @ (level[g] == i + 1) for g in FIELDS))) for f in FIELDS}
        for i, group in enumerate(planar_groups)
    ]
    chains = [
        tuple(Group(z=z, planar=planar, level=i, n_coupled=n_coupled[i]) for i, planar in enumerate(planar_groups))
        for z in _uncoupled_functions(assembly)
    ]

    def is_near(kron: Kron) -> bool:
        there = kron.planar.astype(bool)
        return bool((there > there.multiply(shares[kron.row, kron.column].astype(bool))).nnz == 0)

    return _solver(assembly, chains, planar_groups, is_near)


def _uncoupled_functions(assembly: Assembly) -> list[dict[Field, Index]]:
    """Return the sets of through-thickness functions, for each field, of which no term couples one to another."""
    uncoupled = 1e-12  # of a matrix's largest entry over z: below it, a coupling of two functions is rounding
    ends = np.cumsum([0, *(assembly.n_z[field] for field in FIELDS)])
    linked = np.zeros((ends[-1], ends[-1]), dtype=bool)
    for term in assembly.terms:
        if term.target == "C":
            continue
        for kron in term.krons:
            size = np.abs(kron.z.toarray() if sp.issparse(kron.z) else kron.z)
            r, c = FIELDS.index(kron.row), FIELDS.index(kron.column)
            linked[ends[r] : ends[r + 1], ends[c] : ends[c + 1]] |= size > uncoupled * size.max()
    count, label = sp.csgraph.connected_components(sp.csr_matrix(linked), directed=False)
    return [
        {field: np.flatnonzero(label[ends[i] : ends[i + 1]] == part) for i, field in enumerate(FIELDS)}
        for part in range(count)
    ]


def solver_over_laminas(assembly: Assembly) -> Solver:
    """Cut the equations of all laminas into blocks of one lamina each."""
    planar: Mapping[Field, Index] = {field: np.arange(assembly.plan.size(field)) for field in FIELDS}
    n_lamina = assembly.n_z["w"]
    every = {field: assembly.plan.size(field) for field in FIELDS}
    none = dict.fromkeys(FIELDS, 0)
    groups = tuple(
        Group(
            z=dict.fromkeys(FIELDS, np.array([k])),
            planar=planar,
            level=0,
            n_coupled=every if k + 1 < n_lamina else none,
        )
        for k in range(n_lamina)
    )

    def is_near(kron: Kron) -> bool:
        z = sp.coo_matrix(kron.z)
        return bool(np.all(np.abs(z.row - z.col)[z.data != 0.0] <= 1))

    return _solver(assembly, [groups], [planar], is_near)
