"""Modes of a structure with masses on it, where its points may yield under them."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

_MOST_YIELDING = 0.5
"""Share of the motion of a sensor's mass that may be the yielding of its point."""


def loaded(
    square: NDArray[np.float64], shape: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the modes of a structure with masses on it; of many at once, along leading axes.

    Parameters
    ----------
    square : (..., n_mode) float
        Squared angular frequencies without the masses.
    shape : (..., n_load, n_mode) float
        Mass-normalised shapes at the masses, times the square root of each mass.

    Returns
    -------
    square : (..., n_mode) float
        Squared angular frequencies with the masses, in the order of the modes without.
    turn : (..., n_mode, n_mode) float
        Modes with the masses, in columns, as combinations of those without, mass-normalised and of like sign.
    """
    mass = np.eye(square.shape[-1]) + np.swapaxes(shape, -1, -2) @ shape
    inverse = np.linalg.inv(np.linalg.cholesky(mass))
    back = np.swapaxes(inverse, -1, -2)
    value, vector = np.linalg.eigh((inverse * square[..., None, :]) @ back)
    turn = back @ vector
    own = _places(np.abs(turn))
    turn = np.take_along_axis(turn, own[..., None, :], axis=-1)
    sign = np.sign(np.diagonal(turn, axis1=-2, axis2=-1))
    return np.take_along_axis(value, own, axis=-1), turn * sign[..., None, :]


def _places(size: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return for each row of square matrices, (..., n, n), a column of its own, so that the sum there is largest."""
    n = size.shape[-1]
    every = size.reshape(-1, n, n)
    own = np.argmax(every, axis=-1)  # the largest of all, where no two rows want the same column
    for i in np.flatnonzero((np.sort(own, axis=-1) != np.arange(n)).any(axis=-1)):
        own[i] = scipy.optimize.linear_sum_assignment(-every[i])[1]
    return np.asarray(own.reshape(size.shape[:-1]))


def yielding(
    pair: NDArray[np.int64], size: NDArray[np.float64], flexibility: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return by what sensors move more than the modes of the band have them move, for modes above it let points yield.

    With flexibilities R between them the masses m move by the inverse of I - omega**2 m R, and modes feel m times
    that (as of one point, m / (1 - omega**2 m R)).

    Parameters
    ----------
    pair : (n_pair, 2) int
        Sensors that each flexibility is between.
    size : (n, n_mode) float
        Squared angular frequencies times masses and the unit of the flexibilities.
    flexibility : (n, n_pair) float
        Of n structures.

    Returns
    -------
    root, whole : (n, n_mode, n_sensor, n_sensor) float
        The square root of that inverse, and itself.
    """
    a, b = pair.T
    n_sensor = int(a.max()) + 1
    matrix = np.zeros((len(flexibility), n_sensor, n_sensor))
    matrix[:, a, b] = matrix[:, b, a] = flexibility
    value, vector = np.linalg.eigh(matrix)
    moves = 1.0 / (1.0 - np.clip(size[:, :, None] * value[:, None], -_MOST_YIELDING, _MOST_YIELDING))
    root, whole = (
        np.einsum("nai,nri,nbi->nrab", vector, factor, vector) for factor in (np.sqrt(moves), moves)
    )
    return root, whole
