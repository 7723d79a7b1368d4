"""The basis of equations near a point: modes there, and their responses to coordinates that may move."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model.reduction.reduced_equations import InRange, Matrix, summed
from updating.inference.protocol import Coordinate

Vector = NDArray[np.float64]

N_FURTHER = 13
"""Modes about a point that a local basis holds beyond those whose equations are looked at, beside the static responses
of these."""
RESPONSE = 1e-2
"""Share of a mode's energy, as an amplitude, from which a response counts: 1e-2 leaves 1e-5 of a frequency nearby."""


def times(matrix: Matrix, x: Vector) -> Vector:
    """Return the product of a matrix, in full or of low rank, with vectors."""
    if isinstance(matrix, InRange):
        return np.asarray(matrix.range @ (matrix.core @ (matrix.range.T @ x)))
    return np.asarray(matrix @ x)


def gathered(n: int, parts: Iterable[tuple[float, Matrix]]) -> list[Matrix]:
    """Return the sum of factors times matrices, (n, n), as few matrices: those of one range are one."""
    full, between = list[tuple[float, Vector]](), dict[int, InRange]()
    for factor, matrix in parts:
        if not isinstance(matrix, InRange):
            full.append((factor, matrix))
            continue
        core = factor * matrix.core
        shared = between.get(id(matrix.range))
        between[id(matrix.range)] = replace(matrix, core=core if shared is None else shared.core + core)
    return [*between.values(), *([summed(n, full)] if full else [])]


def parallel(first: Vector, second: Vector) -> bool:
    """Tell whether two forces differ by a factor only."""
    return abs(np.vdot(first, second)) > (1.0 - 1e-6) * np.linalg.norm(first) * np.linalg.norm(second)


def leading(gram: Vector, energy: Vector, mass: Vector) -> Vector:
    """Return a basis of the leading combinations of some vectors.

    Parameters
    ----------
    gram : (n, n) float
        Sum of their squares, each vector times the transpose of `energy`: of modes, scaled to an energy of 1 and more,
        and of responses to steps of coordinates. Squares hold eight digits of a size, more than `RESPONSE` asks for.
    energy : (n, n) float
        Lower Cholesky factor of the matrix that measures energy.
    mass : (n, n) float
        The mass, for which the basis is orthonormal.

    Returns
    -------
    (n, m) float
        The basis, the strongest combinations first.
    """
    _, direction = la.eigh(gram, subset_by_value=(RESPONSE**2, np.inf), check_finite=False)
    basis = la.solve_triangular(energy.T, direction[:, ::-1], check_finite=False)
    root = la.cholesky(basis.T @ mass @ basis, lower=True)
    return np.asarray(la.solve_triangular(root, basis.T, lower=True).T)


MODES = ""
"""The coordinate of vectors that answer to none."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Responses:
    """The vectors that a basis was chosen from: modes, and responses to steps of coordinates.

    Attributes
    ----------
    vectors : (n_basis, n) float
        In coordinates of the whole model.
    within : (size, n_basis) float
        Gives their coordinates in the basis.
    of : (n,) str
        The coordinate of which each is a response.
    number : (n,) int
        The mode that it is, or that responds, from 0 at each point.
    energy : (size, size) float
        Lower Cholesky factor of the matrix that measures energy.
    """

    vectors: Vector
    within: Vector
    of: NDArray[np.str_]
    number: NDArray[np.intp]
    energy: Vector
    _grams: dict[tuple[str, int], Vector] = field(default_factory=dict, repr=False)

    @cached_property
    def _weighed(self) -> Vector:
        return np.asarray(self.energy.T @ self.within @ self.vectors)

    def _gram(self, name: str, n: int) -> Vector:
        """Return the sum of squares of the vectors of a coordinate that belong to the lowest modes, (size, size)."""
        if (name, n) not in self._grams:
            vectors = self._weighed[:, (self.of == name) & (self.number < n)]
            self._grams[name, n] = vectors @ vectors.T
        return self._grams[name, n]

    def basis(self, coordinates: Sequence[Coordinate], at: Mapping[str, float], n_equation: int) -> Vector:
        """Return an orthonormal basis, (size, m), for some of the coordinates.

        Responses to a coordinate that was neutral where the vectors were made are scaled to its starts. Only the
        `n_equation` lowest modes respond.
        """
        total = self._gram(MODES, n_equation + N_FURTHER).copy()
        for c in coordinates:
            far = max(map(abs, c.starts)) / c.step if len(c.starts) > 1 and at[c.name] == 0.0 else 1.0
            total += max(far, 1.0) ** 2 * self._gram(c.name, n_equation)
        return leading(total, self.energy, np.eye(len(total)))
