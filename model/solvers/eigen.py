"""Lowest natural modes by block Krylov iteration with a shifted, factorised stiffness matrix.

A sparse stiffness matrix is factorised in the order that halving the mesh again and again gives: it falls apart
when the nodes of a cut are taken out (George 1973). Each piece is
factorised by dense algebra on the few unknowns that it shares with its cuts (the multifrontal method, Duff and Reid
1983). SuperLU, which scipy has, takes minutes for a plate of solids with 100,000 unknowns; this takes seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from lamella_shared import Integers, Reals
from model.stack.errors import SolveError

Product = Callable[[Reals], Reals]

Block = tuple[Reals, Reals]  # mass-orthonormal vectors and their product with the mass matrix


def orthonormalize(x: Reals, mass: Product, against: Sequence[Block] = ()) -> Block:
    """Return a mass-orthonormal basis of what `x` adds to `against`, and its product with the mass.

    Parameters
    ----------
    x : (n, k)
        Reals.
    mass : callable
        Product with the mass matrix.
    against : sequence of ((n, m), (n, m))
        Reals that are mass-orthonormal, all blocks together, and their products with the mass matrix.

    Returns
    -------
    basis, mass_basis : (n, j)
        Directions that are linearly dependent to 1e-7 are left out, so j may be below k.

    Raises
    ------
    SolveError
        Some of `x` has no mass, or less.
    """
    mass_x = mass(x)
    square = np.einsum("ij,ij->j", x, mass_x)
    if not np.all(square > 0.0):
        raise SolveError("the mass is not positive: something takes off more than there is")
    scale = np.sqrt(square)
    x, mass_x = x / scale, mass_x / scale
    for least in (1e-14, 0.5):  # the second pass removes what rounding left of the first, and what is only that
        if x.shape[1] == 0:
            break
        for basis, mass_basis in against:
            part = mass_basis.T @ x
            x -= basis @ part
            mass_x -= mass_basis @ part
        values, vectors = la.eigh(x.T @ mass_x)
        keep = values > least * max(values[-1], 1.0)
        turn = vectors[:, keep] / np.sqrt(values[keep])
        x, mass_x = x @ turn, mass_x @ turn
    return x, mass_x


def lowest_modes(
    solve: Product,
    mass: Product,
    shift: float,
    start: Reals,
    n_mode: int,
    tolerance: float,
    known: Sequence[Block] = (),
    min_steps: int = 2,
) -> tuple[Reals, Reals]:
    """Return the lowest eigenpairs of K x = lambda M x.

    Parameters
    ----------
    solve : callable
        Product with (K + shift M)^-1 for a block of vectors (n, k).
    mass : callable
        Product with M.
    shift : float
        Positive shift, (rad/s)**2, which makes a free body's stiffness positive definite.
    start : (n, k)
        First block; k should be at least the multiplicity of any eigenvalue.
    n_mode : int
        Number of modes.
    tolerance : float
        Relative change of ``lambda + shift`` from one step to the next at which the iteration ends.
    known : sequence of ((n, m), (n, m))
        Modes known beforehand, such as rigid-body motion: mass-orthonormal, with their products with the
        mass matrix. The modes sought are those besides them.
    min_steps : int
        Steps at least. A start that holds some modes exactly and others hardly at all seems converged before
        the others have come up.

    Returns
    -------
    eigenvalue : (n_mode,)
        Ascending, (rad/s)**2.
    vector : (n, k)
        Mass-normalised. Those beyond the first `n_mode` are further Ritz vectors, not converged, which the
        iteration gives away free.

    Raises
    ------
    SolveError
        The model has fewer modes, its numbers overflow, or there is no convergence within 40 steps.
    """
    max_steps = 40
    blocks = [orthonormalize(start, mass, known)]
    projected = np.zeros((0, 0))
    before = np.zeros(0)
    for step in range(1, max_steps + 1):
        image = solve(blocks[-1][1])
        projected = _grown(projected, np.vstack([mass_basis.T @ image for _, mass_basis in blocks]))
        inverse, vectors = la.eigh(projected)
        now = 1.0 / inverse[::-1][:n_mode]
        steady = now.size == n_mode == before.size and np.all(np.abs(now - before) <= tolerance * now)
        if (steady and step >= min_steps) or _exhausted(blocks, image, mass, known, n_mode - now.size):
            return now - shift, _combined(blocks, vectors[:, ::-1][:, : start.shape[1]])
        before = now
    raise SolveError(f"the {n_mode} lowest modes did not converge in {max_steps} steps")


def _exhausted(blocks: list[Block], image: Reals, mass: Product, known: Sequence[Block], missing: int) -> bool:
    """Add what an image has beyond the blocks to them, and tell whether that is nothing: the space is invariant.

    Raises
    ------
    SolveError
        It is, and modes are still missing.
    """
    n = sum(basis.shape[1] for basis, _ in blocks)
    blocks.append(orthonormalize(image, mass, [*known, *blocks]))
    if blocks[-1][0].shape[1]:
        return False
    if missing > 0:
        raise SolveError(f"the model has no more than {n} modes; ask for fewer, or refine its mesh")
    return True


def _grown(projected: Reals, coupling: Reals) -> Reals:
    """Return a projected matrix with the rows and columns of one more block.

    Raises
    ------
    SolveError
        The numbers overflow.
    """
    grown = completed(projected, coupling)
    grown = (grown + grown.T) / 2.0
    if not np.isfinite(grown).all():
        raise SolveError("the model's numbers overflow; check the size of its stiffnesses, of contact above all")
    return grown


def completed(inner: Reals, added: Reals) -> Reals:
    """Return a symmetric matrix from its leading block and its last columns."""
    known = inner.shape[0]
    matrix = np.zeros((added.shape[0], added.shape[0]))
    matrix[:known, :known], matrix[:, known:], matrix[known:] = inner, added, added.T
    return matrix


def _combined(blocks: Sequence[Block], weight: Reals) -> Reals:
    """Return the sum of the blocks' vectors, each times its rows of `weight`."""
    parts = np.split(weight, np.cumsum([basis.shape[1] for basis, _ in blocks])[:-1])
    return np.asarray(sum(basis @ part for (basis, _), part in zip(blocks, parts, strict=True)))


def inverse_iterated(matrix: Reals, right: Reals) -> Reals:
    """Solve for one step of inverse iteration, also where the shift is an eigenvalue to the last digit.

    Parameters
    ----------
    matrix : (n, n)
        The shifted matrix, symmetric.
    right : (n,)
        Mass times the last vector.

    Returns
    -------
    (n,)
        x with right' x = 1 and matrix x along `right`; the border of that condition keeps a singular matrix solvable.
    """
    bordered, size = _bordered(matrix, right)
    return np.asarray(la.lu_solve(la.lu_factor(bordered), np.append(np.zeros(right.size), size))[:-1])


def orthogonal_answers(matrix: Reals, border: Reals, load: Reals) -> Reals:
    """Solve with a matrix that is singular along one mode, for what is orthogonal to that mode.

    Parameters
    ----------
    matrix : (n, n)
        The matrix shifted by the mode's eigenvalue, symmetric.
    border : (n,)
        Mass times the mode.
    load : (n, k)
        Right-hand sides; what of them lies along `border` is left out.

    Returns
    -------
    (n, k)
        x with border' x = 0.
    """
    bordered, _ = _bordered(matrix, border)
    right = np.vstack([load, np.zeros(load.shape[1])])
    return np.asarray(la.lu_solve(la.lu_factor(bordered), right)[:-1])


def _bordered(matrix: Reals, border: Reals) -> tuple[Reals, float]:
    """Return a symmetric matrix with one more row and column of its own size, and their factor to `border`."""
    n, size = border.size, float(np.abs(matrix).max() / np.abs(border).max())
    bordered = np.zeros((n + 1, n + 1))
    bordered[:n, :n], bordered[:n, n], bordered[n, :n] = matrix, size * border, size * border
    return bordered, size


@dataclass(frozen=True, eq=False, kw_only=True)
class _Front:
    """One piece: its unknowns, those of cuts above that they couple with, and the columns of the factor."""

    inside: Integers
    border: Integers
    diagonal: Reals
    below: Reals


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

    def __init__(self, matrix: sp.csr_matrix, location: Reals) -> None:
        self._matrix = sp.csr_matrix(matrix)
        place, node = np.unique(location, axis=0, return_inverse=True)
        node = node.reshape(-1)
        member = sp.csr_matrix((np.ones(node.size), (node, np.arange(node.size))))
        self._graph = sp.csr_matrix(member @ abs(self._matrix) @ member.T)
        self._unknowns = np.split(np.argsort(node, kind="stable"), np.cumsum(np.bincount(node))[:-1])
        self._rank = np.zeros(node.size, dtype=np.int64)
        self._fronts: list[_Front] = []
        pieces = self._pieces(place, np.arange(len(place)))
        inside = [np.concatenate([self._unknowns[i] for i in piece]) for piece, _ in pieces]
        self._rank[np.concatenate(inside)] = np.arange(node.size)
        waiting: list[tuple[Integers, Reals]] = []
        for unknowns, (_, n_child) in zip(inside, pieces, strict=True):
            children = [waiting.pop() for _ in range(n_child)]
            waiting.append(self._eliminated(unknowns, children))
        del self._matrix, self._graph, self._unknowns, self._rank

    def _pieces(self, place: Reals, nodes: Integers) -> list[tuple[Integers, int]]:
        """Return pieces in the order of elimination, each with its nodes and the number of those below it."""
        most_cut = 0.5  # of the nodes of a piece that a cut may take; with more, cutting does not help
        # nodes of a piece that is cut no further: its dense matrix is about as quick as a sparse one
        leaf = 100
        if nodes.size <= leaf:
            return [(nodes, 0)]
        one, two, cut = min((self._halves(place[nodes, i], nodes) for i in range(3)), key=lambda cut: cut[2].size)
        if not two.size or cut.size > most_cut * nodes.size:
            return [(nodes, 0)]
        rest = np.setdiff1d(two, cut, assume_unique=True)
        parts = [self._pieces(place, part) for part in (one, rest) if part.size]
        return [*(piece for part in parts for piece in part), (cut, len(parts))]

    def _halves(self, along: Reals, nodes: Integers) -> tuple[Integers, Integers, Integers]:
        """Return the nodes below and above the middle of an axis, and those above that couple with those below."""
        lower = along < np.median(along)
        if not lower.any():  # most nodes in one plane
            lower = along <= np.median(along)
        one, two = nodes[lower], nodes[~lower]
        seen = np.zeros(len(self._unknowns), dtype=bool)
        seen[self._graph[one].indices] = True
        return one, two, two[seen[two]] if two.size else nodes

    def _eliminated(self, inside: Integers, children: list[tuple[Integers, Reals]]) -> tuple[Integers, Reals]:
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
            la.blas.dtrsm(1.0, diagonal, front[n:, :n], side=1, lower=1, trans_a=1) if border.size else front[n:, :n]
        )
        left = front[n:, n:] - below @ below.T
        self._fronts.append(_Front(inside=inside, border=border, diagonal=diagonal, below=below))
        return border, left

    def solve(self, right: Reals) -> Reals:
        """Return the solution for right-hand sides, (n, k)."""
        x = np.array(right, dtype=float)
        for front in self._fronts:
            inner = la.solve_triangular(front.diagonal, x[front.inside], lower=True, check_finite=False)
            x[front.inside] = inner
            x[front.border] -= front.below @ inner
        for front in reversed(self._fronts):
            inner = x[front.inside] - front.below.T @ x[front.border]
            x[front.inside] = la.solve_triangular(front.diagonal, inner, lower=True, trans=1, check_finite=False)
        return x
