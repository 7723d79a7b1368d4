"""How much runs scatter beyond their noise, and what that makes of the interval of their mean.

Runs are taken as a random sample of what the structure and its sensors do from run to run: the random-effects model of
repeated measurements of unequal precision.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

_TWO_SIDED = 0.975


def run_scatter(value: NDArray[np.float64], std: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard deviation between runs of each mode, ``(n_mode,)``, beyond what their noise explains.

    The estimate of Paule and Mandel (J. Res. Natl. Bur. Stand. 87, 1982, 377-385): with it, the weighted sum of squares
    about the mean is what it should be. 0 where noise explains all, and where fewer than two runs tell of a mode.

    Parameters
    ----------
    value : (n_run, n_mode) float
        What each run says.
    std : (n_run, n_mode) float
        Its standard deviation from noise; infinite where a run says nothing.
    """
    return np.array(
        [_between(v[np.isfinite(s)], s[np.isfinite(s)]) for v, s in zip(value.T, std.T, strict=True)]
    )


def _between(value: NDArray[np.float64], std: NDArray[np.float64]) -> float:
    def excess(scatter: float) -> float:
        weight = 1.0 / (std**2 + scatter**2)
        return float(np.sum(weight * (value - np.average(value, weights=weight)) ** 2)) - (value.size - 1)

    if value.size < 2 or excess(0.0) <= 0.0:
        return 0.0
    largest = float(np.ptp(value))
    return float(scipy.optimize.brentq(excess, 0.0, largest * np.sqrt(value.size), xtol=1e-6 * largest))


def std_with_scatter(
    std: NDArray[np.float64], run_std: NDArray[np.float64], scatter: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return standard deviations ``(n_mode,)`` of means over runs with the scatter between runs in them.

    What the scatter adds is larger by Student's over the normal quantile of 95 %, squared, for few runs tell little of
    it (Hartung and Knapp, Stat. Med. 20, 2001, 3875-3889) and intervals are taken as normal.

    Parameters
    ----------
    std : (n_mode,) float
        Of the means, from noise.
    run_std : (n_run, n_mode) float
        Of each run, from noise; infinite where a run says nothing.
    scatter : (n_mode,) float
        Standard deviation between runs.
    """
    known = np.isfinite(run_std)
    weight = np.where(known, 1.0, 0.0)
    least = np.where(known, run_std, 1.0)
    within, both = (
        1.0 / np.maximum(np.sum(weight / (least**2 + s**2), axis=0), np.finfo(float).tiny)
        for s in (0.0, scatter)
    )
    freedom = np.maximum(known.sum(axis=0) - 1.0, 1.0)
    quantile = scipy.special.stdtrit(freedom, _TWO_SIDED) / scipy.special.ndtri(_TWO_SIDED)
    more = np.where(scatter > 0.0, both - within, 0.0)
    return np.sqrt(std**2 + quantile**2 * more)
