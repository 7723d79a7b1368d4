"""Symmetric positive definite systems whose unknowns form a chain of blocks.

Each block is coupled to its neighbours only. A stack is such a chain twice: from lamina to lamina, and from
one end of its plan to the other. Dense blocks let LAPACK do the work, and no sparse Cholesky code is
needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from model.errors import SolveError


def levels(pattern: sp.csr_matrix, start: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Group the unknowns by their graph distance from `start`, which makes the matrix block tridiagonal.

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
        message = (
            f"the plan falls into parts: {np.count_nonzero(~seen)} unknowns are not connected to the rest"
        )
        raise SolveError(message)
    return groups[:-1]


@dataclass(frozen=True, eq=False, kw_only=True)
class ChainFactor:
    """Cholesky factor of a block tridiagonal matrix.

    Attributes
    ----------
    groups : list of (n_i,) int
        Unknowns of each block.
    diagonal : list of (n_i, n_i)
        Lower Cholesky factors L of the diagonal blocks.
    below : list of (n_i+1, n_i)
        Blocks below them.
    """

    groups: list[NDArray[np.intp]]
    diagonal: list[NDArray[np.float64]]
    below: list[NDArray[np.float64]]

    def solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the solution for right-hand sides (n, k)."""
        parts = [b[group] for group in self.groups]
        for i, factor in enumerate(self.diagonal):
            if i:
                parts[i] = parts[i] - self.below[i - 1] @ parts[i - 1]
            parts[i] = la.solve_triangular(factor, parts[i], lower=True, check_finite=False)
        x = np.empty_like(b)
        for i in range(len(parts) - 1, -1, -1):
            if i < len(parts) - 1:
                parts[i] = parts[i] - self.below[i].T @ parts[i + 1]
            parts[i] = la.solve_triangular(
                self.diagonal[i], parts[i], lower=True, trans=1, check_finite=False
            )
            x[self.groups[i]] = parts[i]
        return x


def factorize(matrix: sp.csr_matrix, groups: list[NDArray[np.intp]]) -> ChainFactor:
    """Factorise a symmetric positive definite matrix that is block tridiagonal in `groups`.

    Raises
    ------
    SolveError
        The matrix is not positive definite.
    """
    order = np.concatenate(groups)
    ordered = matrix[order][:, order].tocsr()
    stops = np.cumsum([group.size for group in groups])
    diagonal: list[NDArray[np.float64]] = []
    below: list[NDArray[np.float64]] = []
    start = 0
    for i, stop in enumerate(stops):
        block = ordered[start:stop, start:stop].toarray()
        if i:
            block -= below[-1] @ below[-1].T
        try:
            diagonal.append(la.cholesky(block, lower=True, overwrite_a=True, check_finite=False))
        except la.LinAlgError as error:
            message = (
                "the shifted stiffness matrix is not positive definite; check for negative stiffness or mass"
            )
            raise SolveError(message) from error
        if i < len(stops) - 1:
            following = ordered[stop : stops[i + 1], start:stop].toarray()
            below.append(la.solve_triangular(diagonal[-1], following.T, lower=True, check_finite=False).T)
        start = stop
    return ChainFactor(groups=groups, diagonal=diagonal, below=below)
