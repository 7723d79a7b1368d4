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
        message = (
            f"the plan falls into parts: {np.count_nonzero(~seen)} unknowns are not connected to the rest"
        )
        raise SolveError(message)
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

    inverse: list[NDArray[np.float64]]
    below: list[NDArray[np.float64]]

    def solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
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


def factorize(columns: Iterable[tuple[NDArray[np.float64], NDArray[np.float64]]]) -> ChainFactor:
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
    inverse: list[NDArray[np.float64]] = []
    below: list[NDArray[np.float64]] = []
    for block, coupling in columns:
        symmetric = np.asfortranarray(block.T)  # the same matrix, in LAPACK's order without a copy
        if inverse:
            symmetric = la.blas.dsyrk(-1.0, below[-1], beta=1.0, c=symmetric, lower=1, overwrite_c=1)
        lower, failed = la.lapack.dpotrf(symmetric, lower=1, overwrite_a=1)
        if failed:
            message = (
                "the shifted stiffness matrix is not positive definite; check for mass or stiffness that is negative, "
                "or so small, as of contact or interlayers, that the model is singular"
            )
            raise SolveError(message)
        inverse.append(la.lapack.dtrtri(lower, lower=1, overwrite_c=1)[0])
        n_free = block.shape[0] - coupling.shape[0]
        if coupling.size:
            corner = np.asfortranarray(inverse[-1][n_free:, n_free:])
            below.append(la.blas.dtrmm(1.0, corner, coupling.T, side=1, lower=1, trans_a=1, overwrite_b=1))
    return ChainFactor(inverse=inverse, below=below)
