"""Matrices of low rank, kept as what they are in a range that several of them share.

A clamp moves with the mean displacement under it, so its mass, and all that it does when it sits elsewhere, couple a
few dozen directions of several hundred. Most terms of a model with all effects are such: in full they would be two
thirds of its size.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

Vectors = NDArray[np.float64]

_MOST = 1 / 10  # of the basis, that a range may span: with more, full matrices are as quick
_FEWEST = 40  # directions that it may have in any case
_RANK = 1e-11  # of the largest direction of a matrix, below which one is rounding
_SPARE = (
    8  # random vectors beyond the most directions, which show that a range has no more (Halko et al. 2011)
)


@dataclass(frozen=True, eq=False, kw_only=True)
class InRange:
    """A symmetric matrix, range @ core @ range'.

    Attributes
    ----------
    range : (n, r) float
        Columns that span all that the matrix can give; matrices that share it have the same object.
    core : (r, r) float
        The matrix between them.
    """

    range: Vectors
    core: Vectors


Matrix = Vectors | InRange
"""A symmetric matrix in full or in a range."""


def full(matrix: Matrix) -> Vectors:
    """Return a matrix in full, (n, n)."""
    if not isinstance(matrix, InRange):
        return matrix
    found = matrix.range @ matrix.core @ matrix.range.T
    return np.asarray((found + found.T) / 2.0)


def n_row(matrix: Matrix) -> int:
    """Return the number of rows of a matrix."""
    return len(matrix.range if isinstance(matrix, InRange) else matrix)


def summed(n: int, parts: Iterable[tuple[float, Matrix]]) -> Vectors:
    """Return the sum of factors times matrices in full, (n, n)."""
    total, share = np.zeros((2, n, n))
    between: dict[int, tuple[Vectors, Vectors]] = {}
    for factor, matrix in parts:
        if not isinstance(matrix, InRange):
            total += np.multiply(factor, matrix, out=share)
            continue
        shared, core = between.get(id(matrix.range), (matrix.range, np.zeros(matrix.core.shape)))
        between[id(matrix.range)] = shared, core + factor * matrix.core
    for shared, core in between.values():
        total += shared @ core @ shared.T
    return total


def in_ranges(matrices: Sequence[Vectors]) -> list[Matrix]:
    """Return matrices of low rank in ranges that they share, others as they are.

    Parameters
    ----------
    matrices : sequence of (n, n) float
        Symmetric. Those that follow each other are the likeliest to share a range.
    """
    found: list[Matrix] = list(matrices)
    n = len(matrices[0]) if matrices else 0
    most = max(int(_MOST * n), _FEWEST)
    probe = np.random.default_rng(0).standard_normal((n, most + _SPARE))
    groups: list[tuple[Vectors, list[int]]] = []
    for i, matrix in enumerate(matrices):
        own = _orthonormal(matrix @ probe, most)
        if own is None:
            continue
        shared, members = groups[-1] if groups else (own[:, :0], [])
        wider = _with(shared, own)
        if members and wider.shape[1] <= most:
            groups[-1] = wider, [*members, i]
        else:
            groups.append((own, [i]))
    for shared, members in groups:
        for i in members:
            core = shared.T @ matrices[i] @ shared
            found[i] = InRange(range=shared, core=(core + core.T) / 2.0)
    return found


def _with(shared: Vectors, own: Vectors) -> Vectors:
    """Return an orthonormal range with what another has beside it."""
    left = own - shared @ (shared.T @ own)
    left -= shared @ (shared.T @ left)
    further = left[:, np.linalg.norm(left, axis=0) > np.sqrt(_RANK)]
    found = _orthonormal(further, further.shape[1])
    return shared if found is None else np.hstack([shared, found])


def _orthonormal(vectors: Vectors, most: int) -> Vectors | None:
    """Return an orthonormal range of vectors, exactly 0 where their rows are; None where it has too many directions.

    Rigid-body motion is felt by few matrices, and what rounding would put there is large times a large stiffness.
    """
    felt = np.flatnonzero(vectors.any(axis=1))
    direction, triangle, _ = la.qr(vectors[felt], mode="economic", pivoting=True)
    length = np.abs(np.diag(triangle))
    rank = int(np.count_nonzero(length > _RANK * length.max(initial=0.0)))
    if rank > most:
        return None
    found = np.zeros((len(vectors), rank))
    found[felt] = direction[:, :rank]
    return found
