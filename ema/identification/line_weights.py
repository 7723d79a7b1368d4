"""How uncertain each line of a measured function is, from its coherence."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

SMOOTHING = 5
"""Lines over which the variance is averaged: an estimate from few averages scatters much itself."""
LARGEST_RATIO = 1e4
"""Limit on variances over their median: coherences are stored with few digits."""


def coherence_weight(value: NDArray[np.complex128], coherence: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return inverse variances of functions, line by line, relative to one another.

    The variance of the magnitude of a function that is estimated from ``n`` averages is
    ``abs(H)**2 (1 - coherence) / (2 n coherence)`` (Bendat and Piersol, Random Data, 4th ed., table 9.6). Only
    its dependence on frequency is used; the number of averages, which files do not state, drops out.

    Parameters
    ----------
    value : (n_function, n_frequency) complex
        Measured functions.
    coherence : (n_function, n_frequency) float
        Their ordinary coherences, 0 to 1; functions with values outside, or not finite, weigh all lines alike.

    Returns
    -------
    (n_function, n_frequency) float
        Of geometric mean 1 in every function.
    """
    usable = np.all(np.isfinite(coherence) & (coherence >= 0.0) & (coherence <= 1.0 + 1e-6), axis=1)
    held = np.clip(np.where(usable[:, None], coherence, 0.5), 1e-6, 1.0)
    variance = uniform_filter1d(np.abs(value) ** 2 * (1.0 - held) / held, SMOOTHING, axis=1, mode="nearest")
    middle = np.median(variance, axis=1, keepdims=True)
    usable &= middle[:, 0] > 0.0
    middle = np.where(usable[:, None], middle, 1.0)
    weight = 1.0 / np.clip(variance / middle, 1.0 / LARGEST_RATIO, LARGEST_RATIO)
    weight = weight / np.exp(np.mean(np.log(weight), axis=1, keepdims=True))
    return np.where(usable[:, None], weight, 1.0)
