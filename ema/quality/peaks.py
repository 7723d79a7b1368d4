"""Resonances and noise of measured functions, as they stand before any identification.

The likelihood of a fit takes the noise as white. A function that is stored as receptance was often measured by an
accelerometer, so that its noise falls with the square of the frequency, and modes of the upper band would count for
nothing. The noise is measured here, and the fit is made in the quantity where it is the most even, so that the same
data give the same modes as whatever quantity they come.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ema.types.arrays import in_blocks
from ema.types.frf import DERIVATIVE, FRF, Quantity
from lamella_shared import Complexes, Integers, Reals


def find_peaks(level: Reals, prominence: float) -> tuple[Integers, Reals]:
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
    prominences = level[lines] - valley
    kept = prominences >= prominence
    return lines[kept].astype(np.int64), prominences[kept]


def _lowest(level: Reals) -> Reals:
    """Return for each point, (n,), the lowest one from it back to where the curve is higher than it."""
    lowest: list[float] = []
    stack: list[tuple[float, float]] = []  # heights that fall, each with the lowest point behind it
    for value in level.tolist():
        low = value
        while stack and stack[-1][0] <= value:
            low = min(low, stack.pop()[1])
        stack.append((value, low))
        lowest.append(low)
    return np.array(lowest)


def peak_widths(level: Reals, lines: Sequence[int] | Integers) -> Reals:
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


def _crossing(level: Reals, height: float) -> float:
    """Return how far from its first point a curve falls to a height."""
    below = np.flatnonzero(level <= height)
    k = int(below[0]) if below.size else level.size - 1
    if level[k] >= height or k == 0:
        return float(k)
    return float(k - (height - level[k]) / (level[k - 1] - level[k]))


_FEWEST = 8  # second differences in each


def noise_slope(frequency: Reals, value: Complexes, *, blocks: int = 16) -> float:
    """Exponent of the frequency that the noise of functions follows.

    The noise is that of the second differences from line to line, their median in each part of the band, which neither
    a smooth course nor a few sharp resonances enlarge.

    Parameters
    ----------
    frequency : (n_frequency,) float
        Lines above 0 Hz.
    value : (n_function, n_frequency) complex
    blocks : int
        Parts of the band in which the noise is measured.

    Returns
    -------
    float
        Slope of the logarithm of the noise over that of the frequency; 0 where there are too few lines to tell.
    """
    size = (frequency.size - 2) // blocks
    if size < _FEWEST:
        return 0.0
    difference = (np.abs(np.diff(one, 2))[: size * blocks].reshape(blocks, size) for one in value)
    noise = np.array([np.median(one, axis=1) for one in difference])
    middle = frequency[1 : size * blocks + 1].reshape(blocks, size).mean(axis=1)
    if not noise.min() > 0.0:
        return 0.0
    level = np.log(noise).mean(axis=0)
    pairs = np.triu_indices(blocks, 1)
    slopes = (level[pairs[1]] - level[pairs[0]]) / np.log(middle[pairs[1]] / middle[pairs[0]])
    return float(np.median(slopes))  # Theil and Sen: blocks that resonances fill do not count


def whitest(frf: FRF, *, leaning: float = 0.3) -> Quantity:
    """Return the quantity in which the noise of functions, on lines above 0 Hz, is the most even.

    Integration raises the lowest lines of a band that begins near 0 Hz; it goes no further than these bear.

    `leaning`: by how much accelerance, as which most functions are measured, is preferred to what the slope says.
    """
    slope = noise_slope(frf.frequency, frf.value.reshape(-1, frf.frequency.size))
    wanted = DERIVATIVE[frf.quantity] - slope + leaning
    ranked = sorted(DERIVATIVE, key=lambda quantity: abs(DERIVATIVE[quantity] - wanted))
    likely = [q for q in DERIVATIVE if DERIVATIVE[q] >= DERIVATIVE[ranked[0]]]
    return next((q for q in likely if _even_at_the_start(frf.convert(q))), likely[-1])


def _even_at_the_start(frf: FRF, *, loud: float = 10.0) -> bool:
    """Whether the noise of the first lines is no larger than some times that of the others."""
    difference = (np.abs(np.diff(one, 2)) for one in frf.value.reshape(-1, frf.frequency.size))
    first, whole = np.array([(np.median(one[:_FEWEST]), np.median(one)) for one in difference]).T
    return bool(np.median(first) <= loud * np.median(whole))


MIN_LINES = 4.0
"""Fewer lines in a half-power bandwidth do not show a resonance well."""


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


@dataclass(frozen=True, eq=False, kw_only=True)
class LocalFit:
    """A resonance as the lines around its peak have it.

    Attributes
    ----------
    residue : (n_function,) complex
        Residues, in the unit of the functions times rad/s.
    lines : float
        Lines in its half-power bandwidth.
    """

    residue: Complexes
    lines: float


def summed_power(frf: FRF, channels: Integers) -> Reals:
    """Return the power of the functions of some outputs, each relative to its mean, summed: ``(n_frequency,)``."""
    total = np.zeros(frf.frequency.size)
    for block in in_blocks(channels):
        power = np.abs(frf.value[block]) ** 2
        total += (power / np.mean(power, axis=2, keepdims=True)).sum(axis=(0, 1))
    return total


def peaks(frf: FRF, channels: Integers, prominence: float = 10.0, *, narrow_over_noise: float = 50.0) -> list[Peak]:
    """Return the resonances of the summed power that stand out by `prominence` (dB), with half-power bandwidths.

    A peak of few lines is measured by the parabola that the inverse power of a resonance is, and believed
    if it stands out of the lines around it, which a peak of the noise does not.
    """
    if frf.frequency.size < 5 or not channels.size:
        return []
    power = summed_power(frf, channels)
    power = np.maximum(power, 1e-12 * power.max())
    step = float(np.median(np.diff(frf.frequency)))
    lines, _ = find_peaks(10 * np.log10(power), prominence)
    wide = peak_widths(power, lines)
    resonances = []
    for line, width in zip(lines, wide, strict=True):
        frequency, bandwidth = float(frf.frequency[line]), float(width * step)
        inverse = 1 / power[line - 1 : line + 2]
        curvature = (inverse[0] - 2 * inverse[1] + inverse[2]) / 2
        if width < 2 * MIN_LINES:
            around = power[max(line - 50, 0) : line + 51]
            if curvature <= 0 or power[line] < narrow_over_noise * np.median(around):
                continue
            offset = (inverse[0] - inverse[2]) / (4 * curvature)
            least = inverse[1] - curvature * offset**2
            frequency += offset * step
            bandwidth = 2 * float(np.sqrt(max(least, 0.0) / curvature)) * step
        resonances.append(Peak(frequency=frequency, bandwidth=max(bandwidth, 1e-3 * step), line=int(line)))
    return resonances


def residues(frf: FRF, channels: Integers, resonances: list[Peak], *, fewest_lines: int = 8) -> Iterator[LocalFit]:
    """Fit a mode beside a straight part to the lines around each of some peaks, those of a peak between others apart.

    All functions share the pole, so that a resonance that falls between two lines is seen from its flanks. On each
    side it is fitted to as many lines as twice the bandwidth holds, and `fewest_lines` at least.
    """
    step = float(np.median(np.diff(frf.frequency)))
    lines = np.array([peak.line for peak in resonances])
    for peak in resonances:
        reach = int(max(fewest_lines, np.ceil(2.0 * peak.bandwidth / step)))
        below, above = lines[lines < peak.line], lines[lines > peak.line]
        first = max(peak.line - reach, (peak.line + below.max(initial=-peak.line)) // 2 + 1, 0)
        last = min(peak.line + reach, (peak.line + above.min(initial=2 * frf.frequency.size)) // 2 - 1)
        value = frf.value[channels, :, first : last + 1]
        fit = _local_fit(value.reshape(-1, value.shape[-1]), peak.line - first)
        if fit is not None:
            pole, residue = fit
            # With s = 2 pi i f, a residue over lines is one over s times 2 pi i steps.
            yield LocalFit(residue=2j * np.pi * step * residue, lines=2.0 * abs(pole.imag))


def _local_fit(
    value: Complexes, peak: int, *, rounds: int = 8, narrowest: float = 0.02
) -> tuple[complex, Complexes] | None:
    """Fit ``residue / (x - pole) + straight part`` over line numbers x from a peak; None where lines are too few.

    Equations that are multiplied by ``x - pole`` are linear in the pole; divided by that of the round before, they end
    at the fit of the functions themselves (Sanathanan and Koerner, IEEE Trans. Autom. Control 8, 1963).

    `narrowest`: lines of a half bandwidth below which the fit cannot tell it from none.
    """
    size = np.linalg.norm(value, axis=1, keepdims=True)
    value = (value / np.where(size > 0.0, size, 1.0))[size[:, 0] > 0.0]
    x = np.arange(value.shape[1], dtype=float) - peak
    if x.size < 5 or not len(value):
        return None
    powers, pole = np.stack([np.ones(x.size), x, x**2]), 0.5j
    for _ in range(rounds):
        weight = 1.0 / (x - pole)
        basis = np.linalg.qr((powers * weight).T)[0]

        def rough(rows: Complexes, basis: Complexes = basis) -> Complexes:
            return np.asarray(rows - (rows @ basis.conj()) @ basis.T)

        without, times = rough(value * weight), rough(value * weight * x)
        denominator = float(np.sum(np.abs(without) ** 2))
        if denominator == 0.0:
            return None
        pole = complex(np.vdot(without, times) / denominator)
        pole = complex(pole.real, max(abs(pole.imag), narrowest))
    columns = np.stack([1.0 / (x - pole), np.ones(x.size), x])
    coefficient = np.linalg.lstsq(columns.T, value.T, rcond=None)[0]
    if not x[0] < pole.real < x[-1]:
        return None
    return pole, coefficient[0] * size[size > 0.0]


def peaks_of_any_width(
    power: Reals, prominence: float, *, averaged: int = 4, fewest_blocks: int = 64
) -> list[tuple[int, int, int]]:
    """Return `peaks_over_noise`, then those of the power averaged over `averaged` lines, over its square, and so on.

    A resonance that is wide beside the spacing of the lines is seen in noise from which no single line stands out.
    """
    peaks = peaks_over_noise(power, prominence)
    width = averaged
    while power.size >= fewest_blocks * width:
        for line, first, last in peaks_over_noise(power, prominence, averaged=width):
            if not any(known_first <= last and first <= known_last for _, known_first, known_last in peaks):
                peaks.append((line, first, last))
        width *= averaged
    return peaks


def peaks_over_noise(
    power: Reals, prominence: float, *, over_noise: float = 8.0, averaged: int = 1
) -> list[tuple[int, int, int]]:
    """Line, and first and last line around it, of peaks that stand out of the noise, the highest first.

    Peaks are at least `prominence` dB high and `over_noise` standard deviations of the noise. That of power averaged
    over `averaged` lines is the scatter from line to line over the root of their number: from one such mean to the
    next a resonance may rise and fall.
    """
    block = power[: power.size // averaged * averaged].reshape(-1, averaged).mean(axis=1)
    of_lines, level = (10.0 * np.log10(np.maximum(p, 1e-12 * p.max())) for p in (power, block))
    lines, heights = find_peaks(level, prominence)
    peaks = []
    for k in np.argsort(-heights):
        middle = averaged * int(lines[k]) + averaged // 2
        if heights[k] > over_noise * _scatter(of_lines, middle, reach=50 * averaged) / np.sqrt(averaged):
            first, last = _around(level, int(lines[k]), min(0.8 * heights[k], 3.0))
            peaks.append((middle, averaged * first, averaged * (last + 1) - 1))
    return peaks


def _scatter(level: Reals, line: int, *, reach: int) -> float:
    """Return the scatter of a level around a line, from its second differences, which no smooth course enlarges.

    Their variance is 6 times that of a line; the median of absolute normal numbers is 0.6745 standard deviations.
    """
    near = np.abs(np.diff(level[max(0, line - reach) : line + reach + 1], 2))
    return float(np.median(near) / (0.6745 * np.sqrt(6.0)))


def _around(level: Reals, line: int, depth: float, *, lopsided: int = 3) -> tuple[int, int]:
    """First and last line around a peak that lie less than a depth (dB) below it, neither much farther than the other.

    A resonance upon the flanks of others is often a dip and a peak, from which a plateau leads away: of what is more
    than `lopsided` times as far as the steep side, the rest is such a plateau.
    """
    below = np.flatnonzero(level < level[line] - depth)
    before, after = below[below < line], below[below > line]
    first = int(before[-1]) + 1 if before.size else 0
    last = int(after[0]) - 1 if after.size else level.size - 1
    reach = lopsided * max(1, min(line - first, last - line))
    return max(first, line - reach), min(last, line + reach)
