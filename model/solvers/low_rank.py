"""Factorised systems: chains of blocks, and what couples places far apart as a change of low rank.

In a chain each block is coupled to its neighbours only. A stack is such a chain twice: from lamina to lamina, and from
one end of its plan to the other. Dense blocks let LAPACK do the work, and no sparse Cholesky code is
needed.

A clamp moves with the mean displacement of its footprint, so its mass couples all the elements under it.
Left in the matrix, it would weld their blocks of the chain into one large block. It is of low rank, though,
so the Sherman-Morrison-Woodbury formula adds it after the factorisation (Golub and Van Loan, Matrix
Computations, 4th ed., section 2.1.4).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from lamella_shared import Reals
from model.elements.equations import Assembly, Kron, Matrix, Term, ratio
from model.elements.mesh import FIELDS, Field
from model.stack.errors import SolveError


def levels(pattern: sp.csr_matrix, start: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Group the unknowns by their graph distance from `start`, which makes the matrix block tridiagonal.

    In each group those that are coupled to the next one come last.

    Parameters
    ----------
    pattern : sparse (n, n)
        Symmetric pattern of the matrix.
    start : (m,)
        Unknowns of the first group.

    Raises
    ------
    SolveError
        Some unknowns are not connected to `start`.
    """
    seen = np.zeros(pattern.shape[0], dtype=bool)
    seen[start] = True
    groups = [np.asarray(start)]
    while groups[-1].size:
        reached = np.unique(pattern[groups[-1]].indices)
        groups.append(reached[~seen[reached]])
        seen[reached] = True
    if not seen.all():
        raise SolveError(f"the plan falls into parts: {np.count_nonzero(~seen)} unknowns are not connected to the rest")
    result = [groups[-2]]
    for group in groups[-3::-1]:
        coupled = np.isin(group, pattern[result[-1]].indices)
        result.append(np.concatenate([group[~coupled], group[coupled]]))
    return result[::-1]


@dataclass(frozen=True, eq=False, kw_only=True)
class ChainFactor:
    """Cholesky factor of a block tridiagonal matrix.

    Attributes
    ----------
    inverse : list of (n_i, n_i)
        Inverses of the lower Cholesky factors of the diagonal blocks; a product with one is several times
        faster than a triangular solution for the few dozen right-hand sides of a block iteration.
    below : list of (n_i+1, m_i)
        Blocks of the factor below the diagonal, one fewer; their last m_i columns, the others are zero.
    """

    inverse: list[Reals]
    below: list[Reals]

    def solve(self, b: Reals) -> Reals:
        """Return the solution for right-hand sides (n, k), the unknowns in the order of the blocks."""
        ends = np.cumsum([block.shape[0] for block in self.inverse])
        parts = [np.asfortranarray(part) for part in np.split(b, ends[:-1])]
        for i, inverse in enumerate(self.inverse):
            if i:
                coupled = parts[i - 1][parts[i - 1].shape[0] - self.below[i - 1].shape[1] :]
                parts[i] = parts[i] - la.blas.dgemm(1.0, self.below[i - 1], np.asfortranarray(coupled))
            parts[i] = la.blas.dtrmm(1.0, inverse, parts[i], lower=1)
        for i in range(len(parts) - 1, -1, -1):
            if i + 1 < len(parts):
                coupled = parts[i][parts[i].shape[0] - self.below[i].shape[1] :]
                coupled -= la.blas.dgemm(1.0, self.below[i], parts[i + 1], trans_a=1)
            parts[i] = la.blas.dtrmm(1.0, self.inverse[i], parts[i], lower=1, trans_a=1)
        return np.vstack(parts)


def factorize(columns: Iterable[tuple[Reals, Reals]]) -> ChainFactor:
    """Factorise a symmetric positive definite block tridiagonal matrix.

    Parameters
    ----------
    columns : iterable of ((n_i, n_i), (m_i, n_i+1))
        Each diagonal block, and the transpose of the block below it without the columns that are zero; only
        the last m_i unknowns of a block may be coupled to the next.

    Raises
    ------
    SolveError
        The matrix is not positive definite.
    """
    inverse: list[Reals] = []
    below: list[Reals] = []
    for block, coupling in columns:
        symmetric = np.asfortranarray(block.T)  # the same matrix, in LAPACK's order without a copy
        if inverse:
            symmetric = la.blas.dsyrk(-1.0, below[-1], beta=1.0, c=symmetric, lower=1, overwrite_c=1)
        lower, failed = la.lapack.dpotrf(symmetric, lower=1, overwrite_a=1)
        if failed:
            raise SolveError(
                "the shifted stiffness matrix is not positive definite; check for mass or stiffness that is negative, "
                "or so small, as of contact or interlayers, that the model is singular"
            )
        inverse.append(la.lapack.dtrtri(lower, lower=1, overwrite_c=1)[0])
        n_free = block.shape[0] - coupling.shape[0]
        if coupling.size:
            corner = np.asfortranarray(inverse[-1][n_free:, n_free:])
            below.append(la.blas.dtrmm(1.0, corner, coupling.T, side=1, lower=1, trans_a=1, overwrite_b=1))
    return ChainFactor(inverse=inverse, below=below)


@dataclass(frozen=True, eq=False, kw_only=True)
class LowRank:
    """Spaces in which all of some Kronecker products act: for each field, (range over z) x (range over plan).

    Attributes
    ----------
    z : mapping of field to (n_z, q)
        Orthonormal range over z.
    planar : mapping of field to (n_planar, r)
        Orthonormal range over the plan.
    """

    z: Mapping[Field, Reals]
    planar: Mapping[Field, Reals]

    def vectors(self) -> Reals:
        """Return the basis U of the space, (size, rank), field after field."""
        return np.asarray(la.block_diag(*(np.kron(self.z[f], self.planar[f]) for f in FIELDS)))

    def core(self, krons: tuple[Kron, ...]) -> Reals:
        """Return the matrix C, (rank, rank), with which the sum of products is U C U'."""
        ends = np.cumsum([0, *(self.z[f].shape[1] * self.planar[f].shape[1] for f in FIELDS)])
        core = np.zeros((ends[-1], ends[-1]))
        for kron in krons:
            r, c = FIELDS.index(kron.row), FIELDS.index(kron.column)
            block = np.kron(
                self.z[kron.row].T @ (kron.z @ self.z[kron.column]),
                self.planar[kron.row].T @ (kron.planar @ self.planar[kron.column]),
            )
            core[ends[r] : ends[r + 1], ends[c] : ends[c + 1]] += block
            if r != c:
                core[ends[c] : ends[c + 1], ends[r] : ends[r + 1]] += block.T
        return core


@dataclass(frozen=True, eq=False, kw_only=True)
class FarProduct:
    """A Kronecker product of a term that couples places far apart.

    Attributes
    ----------
    term : Term
        The term.
    kron : Kron
        The product.
    row, column : (n_planar, rank)
        Orthonormal ranges of its planar matrix and of that one's transpose.
    """

    term: Term
    kron: Kron
    row: Reals
    column: Reals

    @classmethod
    def of(cls, term: Term, kron: Kron) -> FarProduct:
        """Return the product with its ranges."""
        row, column = (_range([sp.csc_matrix(m)], m.shape[0]) for m in (kron.planar, kron.planar.T))
        return cls(term=term, kron=kron, row=row, column=column)


def low_rank(assembly: Assembly, products: Sequence[FarProduct], members: Mapping[Field, NDArray[np.intp]]) -> LowRank:
    """Find the spaces in which Kronecker products act on the given indices over z."""
    z, planar = {}, {}
    for field in FIELDS:
        factors = [(p.kron.z, p.row) for p in products if p.kron.row == field]
        factors += [(p.kron.z.T, p.column) for p in products if p.kron.column == field]
        here = sp.diags_array(np.isin(np.arange(assembly.n_z[field]), members[field]).astype(float))
        z[field] = _range([sp.csc_matrix(here @ a) for a in _distinct(a for a, _ in factors)], assembly.n_z[field])
        planar[field] = _range([sp.csc_matrix(b) for _, b in factors], assembly.plan.size(field))
    return LowRank(z=z, planar=planar)


def _distinct(matrices: Iterable[Matrix]) -> list[Matrix]:
    """Return the matrices without those that are multiples of others: effects at many places share one over z."""
    found: list[Matrix] = []
    for matrix in matrices:
        if not any(ratio(matrix, other) for other in found):
            found.append(matrix)
    return found


def _range(matrices: list[sp.csc_matrix], n: int) -> Reals:
    """Return an orthonormal basis of the columns of all matrices together, (n, rank)."""
    rank = 1e-11  # singular values below this share of the largest are rounding
    matrices = [m for m in matrices if m.nnz]
    if not matrices:
        return np.zeros((n, 0))
    every = sp.hstack([m / max(abs(m).max(), np.finfo(float).tiny) for m in matrices], format="csc")
    rows = np.unique(every.indices)
    columns = np.flatnonzero(np.diff(every.indptr))
    left, values, _ = la.svd(every[rows][:, columns].toarray(), full_matrices=False)
    left = left[:, values > rank * values.max(initial=0.0)]
    basis = np.zeros((n, left.shape[1]))
    basis[rows] = left
    return basis


@dataclass(frozen=True, eq=False, kw_only=True)
class PartFactor:
    """A factorised part A of a matrix with a change of low rank: A + U C U'.

    Attributes
    ----------
    rows : (n,) int
        Unknowns of the part, in the order of the chain's blocks.
    chain : ChainFactor
        Factor of A.
    vectors : (n, rank)
        U.
    correction : (n, rank)
        A^-1 U (I + C U' A^-1 U)^-1 C.
    """

    rows: NDArray[np.intp]
    chain: ChainFactor
    vectors: Reals
    correction: Reals

    def solve(self, b: Reals) -> Reals:
        """Return the solution for right-hand sides (n, k) of the part."""
        x = self.chain.solve(b)
        if self.vectors.shape[1]:
            x -= self.correction @ (self.vectors.T @ x)
        return x


@dataclass(frozen=True, eq=False, kw_only=True)
class Factor:
    """A factorised matrix, in parts that are not coupled."""

    parts: tuple[PartFactor, ...]

    def solve(self, b: Reals) -> Reals:
        """Return the solution for right-hand sides (n, k)."""
        at_once = 128  # right-hand sides: more of them take memory for copies, and no less time
        x = np.empty_like(b)
        for first in range(0, b.shape[1], at_once):
            some = slice(first, first + at_once)
            for part in self.parts:
                x[part.rows, some] = part.solve(b[part.rows, some])
        return x


def with_change(chain: ChainFactor, rows: NDArray[np.intp], change: LowRank, core: Reals) -> PartFactor:
    """Return the factor of A + U C U' from that of A, whose unknowns are `rows` of the equations."""
    vectors = change.vectors()[rows]
    if not vectors.shape[1]:
        return PartFactor(rows=rows, chain=chain, vectors=vectors, correction=vectors)
    images = chain.solve(vectors)
    inner = np.eye(core.shape[0]) + core @ (vectors.T @ images)
    correction = images @ la.solve(inner, core)
    return PartFactor(rows=rows, chain=chain, vectors=vectors, correction=correction)
