"""A delay between force and response, which turns a driving point at high frequencies as a wrong sign does at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_MOST = 0.75
"""Largest delay that is thought of, in periods of the last line: less than two samples of a usual recorder."""
_TRIED = 151
_SOUND, _TURNED = 0.1, 0.9
"""Shares of negative power below which a delay mends a driving point, and above which a turned sign does."""


def negative_share(mobility: NDArray[np.complex128]) -> float:
    """Return the share of the real part of a driving-point mobility that is negative."""
    real = mobility.real
    return float(-real[real < 0].sum() / max(np.abs(real).sum(), np.finfo(float).tiny))


def delay(mobility: NDArray[np.complex128], frequency: NDArray[np.float64]) -> float | None:
    """Return the delay of the response, s, that makes a driving point of one of negative power; None where none does.

    Parameters
    ----------
    mobility : (n_frequency,) complex
        Of a driving point, along the force.
    frequency : (n_frequency,) float
        Hz, above 0.
    """
    if negative_share(mobility) > _TURNED:
        return None
    tried = np.linspace(-_MOST, _MOST, _TRIED) / frequency[-1]
    share = [negative_share(mobility * np.exp(2j * np.pi * frequency * time)) for time in tried]
    best = int(np.argmin(share))
    return float(tried[best]) if share[best] < _SOUND else None
