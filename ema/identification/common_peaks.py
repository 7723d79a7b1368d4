"""Poles that what is left around them could bring as well: one of many spikes of noise or of a rattle.

Tests of likelihood hold for noise that is normal and even. Where the force has no power left, or a joint rattles, a
band is full of single high lines, and the highest of them look like narrow modes. What the modes leave in the
surroundings tells: a mode stands alone above it, a spike is one of several that are as high. Peaks that are left on the
flanks of modes are no noise but a misfit of these: beside a strong mode a weak one is lower than such, and is a mode.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.identification.functions import Functions
from ema.identification.lsfd import mode_basis
from ema.identification.maximum_likelihood import Fit
from ema.types.frf import Quantity

REACH, FEWEST_LINES = 40.0, 400
"""Half bandwidths on each side of a pole that are its surroundings, and at least so many lines."""
OWN = 4.0
"""Half bandwidths around each pole that are left out, and at least `OWN_LINES` lines: what is left there is misfit."""
OWN_LINES = 3
AS_HIGH, SEVERAL = 0.8, 3
"""Share of a pole's statistic, noise deducted, from which on a peak is as high, and how many such make it common."""
LEFT = 0.3
"""Power that is left around a line over that of the modes there, from which on it is noise and not their misfit."""
_AT_ONCE = 1 << 20  # values of functions that are transformed at once
_NARROWEST = 0.25  # half bandwidth of a matched line, lines


def is_common(data: Functions, fit: Fit) -> NDArray[np.bool_]:
    """Whether what is left around each pole, ``(n_mode,)``, has several peaks that are as high as the pole itself.

    The measure of both is the generalised likelihood ratio of a line as wide as the pole's, its residues free. A pole
    that is not higher than the median of what is left is none either.

    Parameters
    ----------
    data : Functions
        Evenly spaced lines.
    fit : Fit
        A fit of them.
    """
    frequency = data.frequency
    spacing = float(frequency[1] - frequency[0])
    place = (np.abs(fit.pole) / (2.0 * np.pi) - frequency[0]) / spacing
    half = -fit.pole.real / (2.0 * np.pi * spacing)
    own = np.ceil(OWN * half) + OWN_LINES
    common = np.zeros(fit.pole.size, dtype=bool)
    for r, (centre, width) in enumerate(zip(place, half, strict=True)):
        reach = int(max(REACH * width, FEWEST_LINES))
        start, stop = max(0, int(centre) - reach), min(frequency.size, int(centre) + reach + 1)
        if not start <= centre < stop:
            continue  # beyond the band
        lines = slice(start, stop)
        sums = _around_pole(data, fit, r, lines, width)
        number = np.arange(start, stop)
        free = np.all(np.abs(number[:, None] - place) > own, axis=1)
        if not free.any():
            continue
        lost = free & (sums.left > LEFT * sums.modes)
        floor = float(np.median(sums.noise[free]))
        k = int(np.clip(np.round(centre), start, stop - 1)) - start
        peak = float(np.max(sums.whole[max(0, k - 2) : k + 3])) - floor
        high = _number_of_peaks(np.where(lost, sums.noise - floor, 0.0), AS_HIGH * peak, int(own[r]))
        common[r] = peak <= 0.0 or high >= SEVERAL
    return common


@dataclass(kw_only=True)
class _Sums:
    """What all functions together hold on the lines around a pole, `(n_line,)` each."""

    left: NDArray[np.float64]  # power that the fit leaves
    modes: NDArray[np.float64]  # power that it explains
    noise: NDArray[np.float64]  # likelihood of a line as wide as the pole's in what is left
    whole: NDArray[np.float64]  # the same with the pole itself


def _around_pole(data: Functions, fit: Fit, r: int, lines: slice, width: float) -> _Sums:
    """Add up the functions, some at a time: all at once would take several times their memory."""
    frequency = data.frequency[lines]
    sums = _Sums(**{name: np.zeros(frequency.size) for name in ("left", "modes", "noise", "whole")})
    few = max(1, _AT_ONCE // (2 * frequency.size))  # transforms have twice the lines
    for first in range(0, len(data.value), few):
        own = slice(first, first + few)
        scale = np.sqrt(fit.weight[own, lines]) / fit.noise[own, None]
        left = fit.residual[own, lines] * scale
        sums.left += _power(left, width)
        sums.modes += _power((data.value[own, lines] - fit.residual[own, lines]) * scale, width)
        sums.noise += _line_statistic(left, width)
        response = _of_pole(frequency, fit.pole[r], fit.residue[own, r], data.quantity)
        sums.whole += _line_statistic(left + response * scale, width)
    return sums


def _of_pole(
    frequency: NDArray[np.float64], pole: complex, residue: NDArray[np.complex128], quantity: Quantity
) -> NDArray[np.complex128]:
    """Response of one pole and its conjugate, ``(n_function, n_line)``."""
    basis = mode_basis(frequency, np.array([pole]), quantity)[:, :2]
    response = basis @ np.stack([residue.real, residue.imag])
    n = frequency.size
    answer: NDArray[np.complex128] = (response[:n] + 1j * response[n:]).T
    return answer


def _power(scaled: NDArray[np.complex128], half: float) -> NDArray[np.float64]:
    """Power of all functions about every line, the mean over as many as a half bandwidth (lines) on each side."""
    power: NDArray[np.float64] = scipy.ndimage.uniform_filter1d(
        np.sum(np.abs(scaled) ** 2, axis=0), 2 * round(half) + 3
    )
    return power


def _line_statistic(scaled: NDArray[np.complex128], half: float) -> NDArray[np.float64]:
    """Twice the gain of likelihood by a resonance line of a half bandwidth (lines) at every line, ``(n_line,)``."""
    n = scaled.shape[1]
    size = scipy.fft.next_fast_len(2 * n)
    offset = np.arange(size, dtype=float)
    offset[offset > size // 2] -= size
    line = 1.0 / (1.0 + 1j * offset / max(half, _NARROWEST))
    spectrum = scipy.fft.fft(scaled, size, axis=1) * scipy.fft.fft(line).conj()
    total = np.sum(np.abs(scipy.fft.ifft(spectrum, axis=1)[:, :n]) ** 2, axis=0)
    square = scipy.fft.rfft(np.abs(line) ** 2)
    energy = scipy.fft.irfft(scipy.fft.rfft(np.ones(n), size) * square, size)[:n]
    return np.asarray(2.0 * total / energy)


def _number_of_peaks(statistic: NDArray[np.float64], least: float, apart: int) -> int:
    """Count places at which a statistic exceeds a value, no two nearer than so many lines; `SEVERAL` are enough."""
    rest = statistic.copy()
    for number in range(SEVERAL):
        k = int(np.argmax(rest))
        if rest[k] <= max(least, 0.0):
            return number
        rest[max(0, k - apart) : k + apart + 1] = 0.0
    return SEVERAL
