"""Lowest modes of block-tridiagonal equations that a few rows tie to masses, springs and riders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from tests.independent.bench import Array

SHIFT = (2.0 * np.pi * 100.0) ** 2
"""(rad/s)**2, added so that the stiffness of a free body can be inverted."""
BLOCK = 24
"""Vectors that are solved for at once; more than there are rigid-body modes."""
KRYLOV = 4.0
"""Krylov vectors for each mode that is wanted, beside two blocks."""


class Factor:
    """Cholesky factor of a symmetric positive matrix of dense blocks on and just below the diagonal."""

    def __init__(self, diagonal: list[Array], below: list[Array]):
        self._lower: list[Array] = []
        self._below: list[Array] = []
        for i, block in enumerate(diagonal):
            rest = block
            if i:
                left = la.solve_triangular(self._lower[-1], below[i - 1].T, lower=True, check_finite=False).T
                self._below.append(left)
                rest = block - left @ left.T
            self._lower.append(la.cholesky(rest, lower=True, check_finite=False))
        self._ends = np.cumsum([0, *(len(block) for block in diagonal)])

    def solve(self, right: Array) -> Array:
        """Return the solution (n, k) for right-hand sides (n, k)."""
        parts = [right[a:b] for a, b in zip(self._ends[:-1], self._ends[1:], strict=True)]
        for i, lower in enumerate(self._lower):
            rest = parts[i] - self._below[i - 1] @ parts[i - 1] if i else parts[i]
            parts[i] = la.solve_triangular(lower, rest, lower=True, check_finite=False)
        for i in reversed(range(len(parts))):
            rest = parts[i] - self._below[i].T @ parts[i + 1] if i + 1 < len(parts) else parts[i]
            parts[i] = la.solve_triangular(self._lower[i], rest, lower=True, trans=1, check_finite=False)
        return np.vstack(parts)


@dataclass(frozen=True, kw_only=True)
class Tied:
    """A body and what rows tie to it.

    Attributes
    ----------
    factor : Factor
        Of the body's stiffness plus SHIFT times its mass.
    weigh : callable
        The body's mass times vectors (n, k).
    rider : (n_rider,) float
        Masses, kg, that have freedoms of their own, after those of the body.
    row : (n + n_rider, n_row) float
        What each tie measures, as columns.
    mass, stiffness : (n_row,) float
        What each tie weighs and how stiffly it is held.
    """

    factor: Factor
    weigh: Callable[[Array], Array]
    rider: Array
    row: Array
    mass: Array
    stiffness: Array

    def _split(self, vector: Array) -> tuple[Array, Array]:
        n = len(vector) - len(self.rider)
        return vector[:n], vector[n:]

    def _bare(self, vector: Array) -> Array:
        """Return the solution without any ties."""
        body, riding = self._split(vector)
        return np.vstack([self.factor.solve(body), riding / (SHIFT * self.rider[:, None])])

    def weight(self, vector: Array) -> Array:
        """Return the mass matrix times vectors."""
        body, riding = self._split(vector)
        one = np.vstack([self.weigh(body), self.rider[:, None] * riding])
        return one + self.row @ (self.mass[:, None] * (self.row.T @ vector))

    def inverse(self) -> Callable[[Array], Array]:
        """Return the inverse of stiffness plus SHIFT times mass, ties by the Woodbury identity."""
        held = self.stiffness + SHIFT * self.mass
        row = self.row[:, held > 0.0]
        bare = self._bare(row)
        inner = la.cho_factor(row.T @ bare + np.diag(1.0 / held[held > 0.0]), lower=True)

        def apply(vector: Array) -> Array:
            free = self._bare(vector)
            return free - bare @ la.cho_solve(inner, row.T @ free)

        return apply


def lowest(body: Tied, n_mode: int) -> tuple[Array, Array]:
    """Return the lowest squared angular frequencies and their modes of unit modal mass.

    Block Lanczos with full orthogonalisation: the inverse is projected on its own Krylov space.
    """
    inverse = body.inverse()
    n = len(body.row)
    n_block = int(np.ceil((KRYLOV * n_mode + 2 * BLOCK) / BLOCK))
    n_block = min(n_block, n // BLOCK)
    space, weighed = np.empty((n, 0)), np.empty((n, 0))
    projected = np.zeros((n_block * BLOCK,) * 2)
    block = np.random.default_rng(0).standard_normal((n, BLOCK))
    for i in range(n_block):
        here = slice(i * BLOCK, (i + 1) * BLOCK)
        block, heavy = _orthonormal(body, block, space, weighed)
        space, weighed = np.hstack([space, block]), np.hstack([weighed, heavy])
        block = inverse(heavy)
        projected[: here.stop, here] = weighed.T @ block
    upper = np.triu(projected)
    value, turn = la.eigh(upper + np.triu(projected, 1).T)
    best = np.argsort(-value)[:n_mode]
    return 1.0 / value[best] - SHIFT, space @ turn[:, best]


def _orthonormal(body: Tied, block: Array, space: Array, weighed: Array) -> tuple[Array, Array]:
    """Return vectors that are orthonormal with the mass, also to those before, and the mass times them."""
    for _ in range(2):  # once is not enough in floating point
        block = block - space @ (weighed.T @ block)
        block = block / np.linalg.norm(block, axis=0)
    heavy = body.weight(block)
    for _ in range(2):
        chol = la.cholesky(block.T @ heavy, lower=True)
        block, heavy = (la.solve_triangular(chol, one.T, lower=True).T for one in (block, heavy))
    return block, heavy
