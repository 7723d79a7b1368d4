"""Clear resonances of measured functions, as they stand before any identification."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.types.frf import FRF

MIN_LINES = 4.0
"""Fewer lines in a half-power bandwidth do not show a resonance well."""
CLEAR = 10.0
"""Prominence of a clear resonance over the valleys beside it, dB."""
_NARROW_OVER_NOISE = 50.0


@dataclass(frozen=True, kw_only=True)
class Peak:
    """A resonance as a peak of the summed power.

    Attributes
    ----------
    frequency, bandwidth : float
        Its place and half-power bandwidth, Hz.
    line : int
        The line of its largest value.
    """

    frequency: float
    bandwidth: float
    line: int


def summed_power(frf: FRF, channels: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the power of the functions of some outputs, each relative to its mean, summed: ``(n_frequency,)``."""
    power = np.abs(frf.value[channels]) ** 2
    return np.asarray((power / np.mean(power, axis=2, keepdims=True)).sum(axis=(0, 1)))


def peaks(frf: FRF, channels: NDArray[np.int64], prominence: float = CLEAR) -> list[Peak]:
    """Return the resonances of the summed power that stand out by `prominence` (dB), with half-power bandwidths.

    A peak of few lines is measured by the parabola that the inverse power of a resonance is, and believed
    if it stands out of the lines around it, which a peak of the noise does not.
    """
    if frf.frequency.size < 5 or not channels.size:
        return []
    from scipy import signal  # here: it takes long to import, and few commands need it

    power = summed_power(frf, channels)
    power = np.maximum(power, 1e-12 * power.max())
    step = float(np.median(np.diff(frf.frequency)))
    lines, _ = signal.find_peaks(10 * np.log10(power), prominence=prominence)
    wide = signal.peak_widths(power, lines, rel_height=0.5)[0]
    found = []
    for line, width in zip(lines, wide, strict=True):
        frequency, bandwidth = float(frf.frequency[line]), float(width * step)
        inverse = 1 / power[line - 1 : line + 2]
        curvature = (inverse[0] - 2 * inverse[1] + inverse[2]) / 2
        if width < 2 * MIN_LINES:
            around = power[max(line - 50, 0) : line + 51]
            if curvature <= 0 or power[line] < _NARROW_OVER_NOISE * np.median(around):
                continue
            offset = (inverse[0] - inverse[2]) / (4 * curvature)
            least = inverse[1] - curvature * offset**2
            frequency += offset * step
            bandwidth = 2 * float(np.sqrt(max(least, 0.0) / curvature)) * step
        found.append(Peak(frequency=frequency, bandwidth=max(bandwidth, 1e-3 * step), line=int(line)))
    return found
