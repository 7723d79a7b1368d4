"""Orthogonality of modes in the mass of the model.

NASA-STD-5002 (1996) asks of a test-correlated model off-diagonal terms of at most 0.1, and diagonal terms of the
cross-orthogonality of at least 0.9.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def cross_orthogonality(a: ArrayLike, b: ArrayLike, mass: ArrayLike) -> NDArray[np.float64]:
    """Return abs(a' M b) of vectors brought to unit mass, (n_a, n_b): 1 for the same mode, 0 for different ones.

    ``cross_orthogonality(a, a, mass)`` is the orthogonality check of one set.

    Parameters
    ----------
    a, b : (n, n_a), (n, n_b) array_like
        Modes in the coordinates of `mass`, such as `Modes.coordinate` or `Expansion.coordinate`.
    mass : (n, n) array_like
        Mass matrix, such as ``system.matrix("M", theta)``.
    """
    first, second, matrix = np.asarray(a), np.asarray(b), np.asarray(mass)
    product = matrix @ second
    length_a = np.sqrt(_modal_mass(first, matrix))
    length_b = np.sqrt(np.sum(second.conj() * product, axis=0).real)
    return np.abs(first.conj().T @ product) / np.outer(length_a, length_b)


def _modal_mass(vectors: NDArray[Any], mass: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.sum(vectors.conj() * (mass @ vectors), axis=0).real
