"""What the modes beyond a band are thought to do to sensors and frequencies: they go on as those of the band are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_ABOVE = 30
"""Modes above the band that are thought to let a point yield."""


def yielding_beyond(shape: NDArray[np.float64], square: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what modes above the band are thought to yield at a sensor per unit force at each mode, m/N, (n_mode,).

    They go on as far apart as those of the band are, and are felt as they are: the sum of phi**2 / (lambda_s - lambda).
    """
    own = np.sqrt(square)
    apart = np.ptp(own) / (own.size - 1) if own.size > 1 else 0.5 * own[0]
    above = own.max() + apart * np.arange(1, _ABOVE + 1)
    return np.asarray(np.mean(shape**2) * np.sum(1.0 / (above[:, None] ** 2 - square), axis=0))


def moved_by_beyond(square: NDArray[np.float64], lost: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what the next modes beyond both ends of the band may move the frequencies by, as shares of them.

    To second order a mode s moves the squared frequency of a mode r by its share m**2 phi_r**2 phi_s**2 /
    (1 - lambda_s / lambda_r), see Fox and Kapoor, AIAA J. 6, 1968. It is taken to be as far beyond the band as the
    modes in it are apart, and to feel the sensors as they do in the mean.

    Parameters
    ----------
    square : (n_mode,) float
        Squared angular frequencies without the sensors.
    lost : (n_mode,) float
        Shares that the squared frequencies lose by the sensors, m phi**2.
    """
    own = np.sort(np.sqrt(square))
    apart = (own[-1] - own[0]) / (own.size - 1) if own.size > 1 else 0.5 * own[0]
    ends = np.array([end for end in (own[0] - apart, own[-1] + apart) if end > 0.0])
    near = np.abs(1.0 - ends[:, None] ** 2 / square)
    return np.asarray(0.5 * lost * lost.mean() * np.sum(1.0 / near, axis=0))
