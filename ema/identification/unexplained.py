"""Peaks that the measured functions show, or that stand in what the fitted modes leave of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.identification.functions import Functions
from ema.identification.maximum_likelihood import Fit
from ema.quality.peaks import find_peaks

VISIBLE = 1.0
"""Height over the valleys beside it from which on a peak of the summed power is seen by anyone, dB."""
PROMINENCE = 3.0
"""Height of a peak of what is left, dB."""
LEAST_SHARE = 0.1
"""Share of a peak's power from which on it counts as unexplained."""
LEAST_ALONE = 0.01
"""The same for a peak that has no mode: its neighbours' flanks may add up to most of its power."""
OVER_NOISE = 8.0
"""Standard deviations of the noise from line to line that a peak stands over the valleys beside it."""
LEAST_HIDDEN = 0.2
"""The same where only what is left has a peak: less is a misfit of the modes beside it."""
LOPSIDED = 3
"""Times as many lines as on its steep side that a peak has on the other one at most: the rest is a plateau."""
_OWN_LINES = 1.5
_NOISE_LINES = 50
_BLOCKS = 4  # lines that are averaged, then its powers
_FEWEST_BLOCKS = 64
_MEDIAN_NORMAL = 0.6745
_FLOOR = 1e-12


@dataclass(frozen=True, eq=False, kw_only=True)
class Peak:
    """A peak that the modes leave unexplained.

    Attributes
    ----------
    line : int
        Line of its largest value.
    frequency : float
        Its place, Hz.
    first, last : int
        Lines within which it holds more than half of its power, or stands over the valleys beside it.
    share : float
        Share of the power between them that is left.
    left : (n_function,) float
        The same for each function.
    visible : bool
        Whether anyone sees it in the summed power, and not only in what is left of it.
    """

    line: int
    frequency: float
    first: int
    last: int
    share: float
    left: NDArray[np.float64]
    visible: bool

    @property
    def window(self) -> slice:
        """Its lines."""
        return slice(self.first, self.last + 1)

    @property
    def half_width(self) -> float:
        """Half of its width, lines."""
        return max(0.5 * (self.last - self.first), 0.5)


def powers(data: Functions, fit: Fit) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Power by line, (n_frequency,), of all functions and of what is left, each over its mean, and of all as they are.

    Functions are taken one by one, for they may be the larger part of the memory.
    """
    whole, left, plain = np.zeros((3, data.frequency.size))
    for value, rest in zip(data.value, fit.residual, strict=True):
        square = np.abs(value) ** 2
        size = np.mean(square)
        plain += square
        whole += square / size
        left += np.abs(rest) ** 2 / size
    return whole, left, plain


def left_of_functions(data: Functions, fit: Fit, window: slice) -> NDArray[np.float64]:
    """Share of the power of each function, (n_function,), that a fit leaves on some lines."""
    rest, each = (np.sum(np.abs(own[:, window]) ** 2, axis=1) for own in (fit.residual, data.value))
    return np.asarray(rest / each)


def left_at_poles(data: Functions, fit: Fit) -> NDArray[np.float64]:
    """Share of the power that a fit leaves in the half bandwidths around each of its poles, ``(n_mode,)``."""
    each, rest, _ = powers(data, fit)
    spacing = float(data.frequency[1] - data.frequency[0])
    reach = np.maximum(-fit.pole.real / (2.0 * np.pi), _OWN_LINES * spacing)
    own = np.abs(data.frequency - fit.pole.imag[:, None] / (2.0 * np.pi)) <= reach[:, None]
    return np.asarray((own @ rest) / np.maximum(own @ each, np.finfo(float).tiny))


def holds_pole(data: Functions, fit: Fit, peak: Peak) -> bool:
    """Whether one of the fitted poles lies in a peak."""
    spacing = float(data.frequency[1] - data.frequency[0])
    distance = np.abs(fit.pole.imag / (2.0 * np.pi) - peak.frequency)
    return bool(np.any(distance <= spacing * max(peak.half_width, 1.0)))


def unexplained_peaks(data: Functions, fit: Fit) -> list[Peak]:
    """Find the peaks of which a fit leaves more than noise, the largest first.

    These are the peaks of the functions' summed power, as measured and with each function over its mean, and those of
    what is left of it: a mode between two others may be no more than a shoulder. Functions over their mean show a mode
    of which most of them have little, and their plain sum one that is strong in a few of which the mean is large.
    """
    power, left, plain = powers(data, fit)
    seen = [(*place, True) for own in (power, plain) for place in _peaks_of_any_width(own, VISIBLE)]
    hidden = [(*place, False) for place in _peaks(left, PROMINENCE)]
    found: list[Peak] = []
    for line, first, last, visible in seen + hidden:
        window = slice(first, last + 1)
        peak = Peak(
            line=line,
            frequency=float(data.frequency[line]),
            first=first,
            last=last,
            share=float(left[window].sum() / power[window].sum()),
            left=left_of_functions(data, fit, window),
            visible=visible,
        )
        alone = visible and not holds_pole(data, fit, peak)
        least = LEAST_ALONE if alone else LEAST_SHARE if visible else LEAST_HIDDEN
        known = any(other.first <= line <= other.last for other in found)
        if not known and peak.share > least:
            found.append(peak)
    return sorted(found, key=lambda peak: -left[peak.line])


def _peaks_of_any_width(power: NDArray[np.float64], prominence: float) -> list[tuple[int, int, int]]:
    """Return `_peaks`, then those that stand out of the noise where the power of several lines is averaged.

    A resonance that is wide beside the spacing of the lines is seen in noise from which no single line stands out.
    """
    found = _peaks(power, prominence)
    width = _BLOCKS
    while power.size >= _FEWEST_BLOCKS * width:
        block = power[: power.size // width * width].reshape(-1, width).mean(axis=1)
        for line, first, last in _peaks(block, prominence):
            start, stop = width * first, width * (last + 1)
            if not any(own_first < stop and start <= own_last for _, own_first, own_last in found):
                found.append((width * line + width // 2, start, stop - 1))
        width *= _BLOCKS
    return found


def _peaks(power: NDArray[np.float64], prominence: float) -> list[tuple[int, int, int]]:
    """Line, and first and last line around it, of peaks that stand out of the noise, the highest first."""
    level = 10.0 * np.log10(np.maximum(power, _FLOOR * power.max()))
    lines, heights = find_peaks(level, prominence)
    return [
        (int(lines[k]), *_around(level, int(lines[k]), min(0.8 * heights[k], 3.0)))
        for k in np.argsort(-heights)
        if heights[k] > OVER_NOISE * _scatter(level, int(lines[k]))
    ]


def _scatter(level: NDArray[np.float64], line: int) -> float:
    """Return the scatter of a level around a line, from its second differences, which no smooth course enlarges."""
    near = np.abs(np.diff(level[max(0, line - _NOISE_LINES) : line + _NOISE_LINES + 1], 2))
    return float(np.median(near) / (_MEDIAN_NORMAL * np.sqrt(6.0)))


def _around(level: NDArray[np.float64], line: int, depth: float) -> tuple[int, int]:
    """First and last line around a peak that lie less than a depth (dB) below it, neither much farther than the other.

    A resonance upon the flanks of others is often a dip and a peak, from which a plateau leads away.
    """
    below = np.flatnonzero(level < level[line] - depth)
    before, after = below[below < line], below[below > line]
    first = int(before[-1]) + 1 if before.size else 0
    last = int(after[0]) - 1 if after.size else level.size - 1
    reach = LOPSIDED * max(1, min(line - first, last - line))
    return max(first, line - reach), min(last, line + reach)
