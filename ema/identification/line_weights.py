"""How uncertain each line of a measured function is, from its coherence or from what a fit leaves of it."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

SMOOTHING = 5
"""Lines over which the variance is averaged: an estimate from few averages scatters much itself."""
LARGEST_RATIO = 1e4
"""Limit on variances over their median: coherences are stored with few digits."""
_ROUNDS = 50
_SETTLED = 1e-9  # relative change of both parts
_FACTOR = 5.0  # by which a part of the variance may fall in a step


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
    variance = scipy.ndimage.uniform_filter1d(
        np.abs(value) ** 2 * (1.0 - held) / held, SMOOTHING, axis=1, mode="nearest"
    )
    middle = np.median(variance, axis=1, keepdims=True)
    usable &= middle[:, 0] > 0.0
    middle = np.where(usable[:, None], middle, 1.0)
    weight = 1.0 / np.clip(variance / middle, 1.0 / LARGEST_RATIO, LARGEST_RATIO)
    weight = weight / np.exp(np.mean(np.log(weight), axis=1, keepdims=True))
    return np.where(usable[:, None], weight, 1.0)


def misfit_weight(fitted: NDArray[np.complex128], residual: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return inverse variances of functions of which a fit leaves much where it is large, as in `coherence_weight`.

    What is left of a line is taken for complex normal of variance ``noise**2 + error**2 abs(H)**2``, with H as it was
    fitted: besides noise, a resonance that is not quite that of a linear mode leaves a part of itself. Both are those
    of the largest likelihood in each function, by Fisher scoring.

    Parameters
    ----------
    fitted, residual : (n_function, n_frequency) complex
        A fit of functions, and what it leaves of them; neither is all zero in any of them.

    Returns
    -------
    (n_function, n_frequency) float
        Of geometric mean 1 in every function.
    """
    weight = _inverse_variance(np.abs(fitted) ** 2, np.abs(residual) ** 2)
    return weight / np.exp(np.mean(np.log(weight), axis=1, keepdims=True))


def _inverse_variance(power: NDArray[np.float64], left: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return inverse variances of all functions, two unknowns each, (n_function, n_frequency)."""
    power, left = (own / np.mean(own, axis=1, keepdims=True) for own in (power, left))
    part = np.stack([np.median(left, axis=1), np.full(len(left), 1e-4)], axis=1)
    moving = np.arange(len(part))
    for _ in range(_ROUNDS):
        own, constant, growing = power[moving], part[moving, :1], part[moving, 1:]
        first = 1.0 / (constant + growing * own)
        second, target = own * first, left[moving] * first - 1.0
        rows = np.stack([first, second], axis=1)
        size = np.linalg.norm(rows, axis=2, keepdims=True)
        rows /= size
        normal = np.linalg.pinv(rows @ rows.swapaxes(1, 2), rcond=1e-12, hermitian=True)
        step = (normal @ (rows @ target[..., None]) / size)[..., 0]
        changed = np.maximum(part[moving] + step, part[moving] / _FACTOR)
        still = np.any(np.abs(changed - part[moving]) > _SETTLED * part[moving], axis=1)
        part[moving] = changed
        moving = moving[still]
        if not moving.size:
            break
    return np.asarray(1.0 / (part[:, :1] + part[:, 1:] * power))
