"""Symmetric positive definite systems whose unknowns form a chain of blocks.

Each block is coupled to its neighbours only. A stack is such a chain twice: from lamina to lamina, and from
one end of its plan to the other. Dense blocks let LAPACK do the work, and no sparse Cholesky code is
needed.
"""

from __future__ import annotations

from collections.abc import Iterable
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
    inverse : list of (n_i, n_i)
        Inverses of the lower Cholesky factors of the diagonal blocks; a product with one is several times
        faster than a triangular solution for the few dozen right-hand sides of a block iteration.
    below : list of (m_i, n_i)
        Blocks of the factor below the diagonal: m_i is n_i+1, or 0 where a block and the next are not
        coupled.
    """

    groups: list[NDArray[np.intp]]
    inverse: list[NDArray[np.float64]]
    below: list[NDArray[np.float64]]

    def solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the solution for right-hand sides (n, k)."""
        parts = [b[group] for group in self.groups]
        parts[0] = self.inverse[0] @ parts[0]
        for i in range(1, len(parts)):
            if self.below[i - 1].size:
                parts[i] -= self.below[i - 1] @ parts[i - 1]
            parts[i] = self.inverse[i] @ parts[i]
        x = np.empty_like(b)
        parts[-1] = self.inverse[-1].T @ parts[-1]
        x[self.groups[-1]] = parts[-1]
        for i in range(len(parts) - 2, -1, -1):
            if self.below[i].size:
                parts[i] -= self.below[i].T @ parts[i + 1]
            parts[i] = self.inverse[i].T @ parts[i]
            x[self.groups[i]] = parts[i]
        return x


def factorize(columns: Iterable[NDArray[np.float64]], groups: list[NDArray[np.intp]]) -> ChainFactor:
    """Factorise a symmetric positive definite block tridiagonal matrix.

    Parameters
    ----------
    columns : iterable of (n_i + m_i, n_i)
        Each block's columns from the diagonal block down, m_i as in `ChainFactor`.
    groups : list of (n_i,) int
        The unknowns of each block.

    Raises
    ------
    SolveError
        The matrix is not positive definite.
    """
    inverse: list[NDArray[np.float64]] = []
    below: list[NDArray[np.float64]] = []
    for both, group in zip(columns, groups, strict=True):
        block, coupling = both[: group.size], both[group.size :]
        if below and below[-1].size:
            block = block - la.blas.dsyrk(1.0, below[-1], lower=1)  # its lower triangle, all that is read
        try:
            lower = la.cholesky(block, lower=True, check_finite=False)
        except la.LinAlgError as error:
            message = (
                "the shifted stiffness matrix is not positive definite; check for negative stiffness or mass"
            )
            raise SolveError(message) from error
        inverse.append(la.lapack.dtrtri(lower, lower=1)[0])
        if coupling.size:
            coupling = la.blas.dtrmm(1.0, inverse[-1], coupling, side=1, lower=1, trans_a=1)
        below.append(coupling)
    return ChainFactor(groups=groups, inverse=inverse, below=below)
