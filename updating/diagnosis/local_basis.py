"""What the basis of equations near a point holds: modes there, and how they answer to what may move."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model.reduction.reduced_equations import InRange, Matrix

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


def parallel(one: Vector, other: Vector) -> bool:
    """Tell whether two forces differ by a factor only."""
    return abs(np.vdot(one, other)) > (1.0 - 1e-6) * np.linalg.norm(one) * np.linalg.norm(other)


def leading(blocks: Vector, energy: Vector, mass: Vector) -> Vector:
    """Return a basis of what counts in some vectors.

    Parameters
    ----------
    blocks : (n, k) float
        Modes, scaled to an energy of 1 and more, and responses to steps of coordinates.
    energy : (n, n) float
        Lower Cholesky factor of the matrix that measures energy.
    mass : (n, n) float
        The mass, for which the basis is orthonormal.

    Returns
    -------
    (n, m) float
        The basis, the strongest combinations first.
    """
    weighed = energy.T @ blocks
    if weighed.shape[1] > 2 * weighed.shape[0]:
        square, direction = la.eigh(weighed @ weighed.T)
        order = np.argsort(-square)
        strength, direction = np.sqrt(np.maximum(square[order], 0.0)), direction[:, order]
    else:
        direction, strength, _ = la.svd(weighed, full_matrices=False)
    kept = int(np.count_nonzero(strength > RESPONSE))
    basis = la.solve_triangular(energy.T, direction[:, :kept])
    root = la.cholesky(basis.T @ mass @ basis, lower=True)
    return np.asarray(la.solve_triangular(root, basis.T, lower=True).T)
