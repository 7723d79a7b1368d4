"""Cholesky factor of a large sparse matrix, in the order that halving the mesh again and again gives.

The matrix of a finite-element mesh falls apart when the nodes of a cut are taken out (George 1973). Each piece is
factorised by dense algebra on the few unknowns that it shares with its cuts (the multifrontal method, Duff and Reid
1983). SuperLU, which scipy has, takes minutes for a plate of solids with 100,000 unknowns; this takes seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from model.stack.errors import SolveError

Vectors = NDArray[np.float64]
Index = NDArray[np.int64]

_LEAF = 100  # nodes of a piece that is cut no further: its dense matrix is about as quick as a sparse one
_MOST_CUT = 0.5  # of the nodes of a piece that a cut may take; with more, cutting does not help


@dataclass(frozen=True, eq=False, kw_only=True)
class _Front:
    """One piece: its unknowns, those of cuts above that they couple with, and the columns of the factor."""

    inside: Index
    border: Index
    diagonal: Vectors
    below: Vectors


class NotPositiveError(SolveError):
    """A pivot is not positive.

    Attributes
    ----------
    index : int
        Row of the matrix at which elimination stopped.
    """

    index: int

    def __init__(self, index: int) -> None:
        super().__init__(f"the matrix is not positive definite at row {index}")
        self.index = index


class CholeskyFactor:
    """Factor of a symmetric positive definite sparse matrix.

    Parameters
    ----------
    matrix : (n, n) sparse
        The matrix, with both triangles.
    location : (n, 3)
        Where each unknown is; those at one place stay together. Only speed depends on it.

    Raises
    ------
    NotPositiveError
        The matrix is not positive definite.
    """

    def __init__(self, matrix: sp.csr_matrix, location: Vectors) -> None:
        self._matrix = sp.csr_matrix(matrix)
        place, node = np.unique(location, axis=0, return_inverse=True)
        node = node.reshape(-1)
        member = sp.csr_matrix((np.ones(node.size), (node, np.arange(node.size))))
        self._graph = sp.csr_matrix(member @ abs(self._matrix) @ member.T)
        self._unknowns = np.split(np.argsort(node, kind="stable"), np.cumsum(np.bincount(node))[:-1])
        self._rank = np.zeros(node.size, dtype=np.int64)
        self._fronts: list[_Front] = []
        pieces = self._pieces(place, np.arange(len(place)))
        inside = [np.concatenate([self._unknowns[i] for i in own]) for own, _ in pieces]
        self._rank[np.concatenate(inside)] = np.arange(node.size)
        waiting: list[tuple[Index, Vectors]] = []
        for own, (_, n_child) in zip(inside, pieces, strict=True):
            children = [waiting.pop() for _ in range(n_child)]
            waiting.append(self._eliminated(own, children))
        del self._matrix, self._graph, self._unknowns, self._rank

    def _pieces(self, place: Vectors, nodes: Index) -> list[tuple[Index, int]]:
        """Return pieces in the order of elimination, each with its nodes and the number of those below it."""
        if nodes.size <= _LEAF:
            return [(nodes, 0)]
        one, two, cut = min(
            (self._halves(place[nodes, i], nodes) for i in range(3)), key=lambda own: own[2].size
        )
        if not two.size or cut.size > _MOST_CUT * nodes.size:
            return [(nodes, 0)]
        rest = np.setdiff1d(two, cut, assume_unique=True)
        parts = [self._pieces(place, part) for part in (one, rest) if part.size]
        return [*(piece for part in parts for piece in part), (cut, len(parts))]

    def _halves(self, along: Vectors, nodes: Index) -> tuple[Index, Index, Index]:
        """Return the nodes below and above the middle of an axis, and those above that couple with those below."""
        lower = along < np.median(along)
        if not lower.any():  # most nodes in one plane
            lower = along <= np.median(along)
        one, two = nodes[lower], nodes[~lower]
        seen = np.zeros(len(self._unknowns), dtype=bool)
        seen[self._graph[one].indices] = True
        return one, two, two[seen[two]] if two.size else nodes

    def _eliminated(self, inside: Index, children: list[tuple[Index, Vectors]]) -> tuple[Index, Vectors]:
        """Eliminate the unknowns of one piece and return those that it leaves coupled, with their matrix."""
        rows = self._matrix[inside]
        reached = np.unique(np.concatenate([rows.indices, *(border for border, _ in children)]))
        border = reached[self._rank[reached] > self._rank[inside].max()]
        border = border[np.argsort(self._rank[border])]
        n, size = inside.size, inside.size + border.size
        where = np.full(self._rank.size, -1, dtype=np.int64)
        where[inside], where[border] = np.arange(n), np.arange(n, size)
        front = np.zeros((size, size), order="F")
        local = where[rows.indices]
        kept = local >= 0
        row = np.repeat(np.arange(n), np.diff(rows.indptr))[kept]
        front[local[kept], row] = rows.data[kept]
        for known, part in children:
            at = where[known]
            front[np.ix_(at, at)] += part
        diagonal, info = la.lapack.dpotrf(front[:n, :n], lower=1, clean=1)
        if info:
            raise NotPositiveError(int(inside[info - 1]))
        below = (
            la.blas.dtrsm(1.0, diagonal, front[n:, :n], side=1, lower=1, trans_a=1)
            if border.size
            else front[n:, :n]
        )
        left = front[n:, n:] - below @ below.T
        self._fronts.append(_Front(inside=inside, border=border, diagonal=diagonal, below=below))
        return border, left

    def solve(self, right: Vectors) -> Vectors:
        """Return the solution for right-hand sides, (n, k)."""
        x = np.array(right, dtype=float)
        for front in self._fronts:
            own = la.solve_triangular(front.diagonal, x[front.inside], lower=True, check_finite=False)
            x[front.inside] = own
            x[front.border] -= front.below @ own
        for front in reversed(self._fronts):
            own = x[front.inside] - front.below.T @ x[front.border]
            x[front.inside] = la.solve_triangular(
                front.diagonal, own, lower=True, trans=1, check_finite=False
            )
        return x
