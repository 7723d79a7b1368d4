"""Peaks of a curve with prominence and width, as `scipy.signal` finds them, whose import takes a second or more."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def find_peaks(
    level: NDArray[np.float64], prominence: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the positions of peaks, (n_peak,), and their prominences, of those with at least a given one.

    The prominence is the height over the higher of the lowest points on both sides, before anything is higher than the
    peak. A flat top counts in its middle; what falls off at an end of the curve is no peak.

    Parameters
    ----------
    level : (n,) float
    prominence : float
        The least one.
    """
    starts = np.flatnonzero(np.diff(level, prepend=np.nan) != 0)  # of stretches of equal values
    ends = np.append(starts[1:], level.size) - 1
    height = level[starts]
    if height.size < 3:
        return np.empty(0, dtype=np.int64), np.empty(0)
    top = np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] > height[2:])) + 1
    lines = (starts[top] + ends[top]) // 2
    valley = np.maximum(_lowest(level)[lines], _lowest(level[::-1])[::-1][lines])
    own = level[lines] - valley
    kept = own >= prominence
    return lines[kept].astype(np.int64), own[kept]


def _lowest(level: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return for each point, (n,), the lowest one from it back to where the curve is higher than it."""
    lowest: list[float] = []
    stack: list[tuple[float, float]] = []  # heights that fall, each with the lowest point behind it
    for own in level.tolist():
        low = own
        while stack and stack[-1][0] <= own:
            low = min(low, stack.pop()[1])
        stack.append((own, low))
        lowest.append(low)
    return np.array(lowest)


def peak_widths(level: NDArray[np.float64], lines: Sequence[int] | NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the widths of peaks, (n_peak,), in lines at half their prominence, between the lines interpolated.

    Parameters
    ----------
    level : (n,) float
    lines : sequence of int
        Positions of the peaks.
    """
    left, right = _lowest(level), _lowest(level[::-1])[::-1]
    widths = []
    for line in lines:
        half = level[line] - 0.5 * (level[line] - max(left[line], right[line]))
        before = _crossing(level[line::-1], half)
        after = _crossing(level[line:], half)
        widths.append(before + after)
    return np.array(widths)


def _crossing(level: NDArray[np.float64], height: float) -> float:
    """Return how far from its first point a curve falls to a height."""
    below = np.flatnonzero(level <= height)
    k = int(below[0]) if below.size else level.size - 1
    if level[k] >= height or k == 0:
        return float(k)
    return float(k - (height - level[k]) / (level[k - 1] - level[k]))
