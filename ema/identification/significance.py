"""Which of the fitted poles are modes of the structure.

A mode must stand out of the noise of the measurement. That is necessary and, with measured data, not
sufficient: a small misfit of a strong mode is as significant as a weak mode. So a pole that does not dominate
the response at its own frequency must in addition look like a mode, that is have residues on one phase line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.identification.maximum_likelihood import Fit
from ema.types.arrays import BLOCK
from ema.types.frf import DERIVATIVE, Quantity

FALSE_ALARM = 1e-4
"""Chance that noise alone brings forth a significant pole anywhere in the band."""
DOMINANT = 3.0
"""Peak over the rest of the response at resonance from which on a pole is a mode whatever its phases."""
MIN_COLLINEARITY = 0.9
"""Least phase collinearity of the residues of a pole that does not dominate."""
MIN_REALNESS = 0.5
"""Least share of a non-dominant pole's modal constants along the real axis, where real modes have them."""

_NOTHING = 1e-24  # of the power of a peak, where it is all there is
MAX_LINE_DAMPING = 0.2
"""Widest resonance, as a damping ratio, that is searched for in the residuals."""
CONFINED_SHARE, NEIGHBOUR_DISTANCE = 0.8, 0.02
"""Share of one run in a pole that is no mode, and how near, relative to its size, the true one then is."""
TRIES_PER_WIDTH = 5
"""Places of each width that are looked at."""
SPLIT_DISTANCE, SPLIT_MAC = 2.0, 0.8
"""Poles closer than this many sums of their half bandwidths with shapes more alike are one mode."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Verdicts:
    """Measures of every pole of a fit and what follows from them.

    Attributes
    ----------
    statistic : (n_mode,) float
        Wald statistic of all residues of the pole being zero; chi-squared of twice the number of functions
        for noise. A misfit around the pole counts as noise.
    threshold : float
        Least statistic of a significant pole.
    dominance : (n_mode,) float
        Root mean square over the functions of the pole's peak over that of everything else at its frequency.
    collinearity, realness : (n_mode,) float
        Phase collinearity of the modal constants and their share along the real axis, corrected for noise.
    """

    statistic: NDArray[np.float64]
    threshold: float
    dominance: NDArray[np.float64]
    collinearity: NDArray[np.float64]
    realness: NDArray[np.float64]

    @property
    def accepted(self) -> NDArray[np.bool_]:
        """Which poles are modes, ``(n_mode,)``."""
        modal = (self.collinearity >= MIN_COLLINEARITY) & (self.realness >= MIN_REALNESS)
        return (self.statistic > self.threshold) & ((self.dominance >= DOMINANT) | modal)

    @property
    def score(self) -> NDArray[np.float64]:
        """How much each pole looks like a mode, for taking the least likely one away first."""
        return (
            np.minimum(self.dominance, 1.0)
            * self.collinearity
            * np.minimum(1.0, self.statistic / self.threshold)
        )


def significance_threshold(n_function: int, n_frequency: int) -> float:
    """Statistic that noise exceeds anywhere in the band with probability `FALSE_ALARM`.

    The pole itself is searched for: it adds two unknowns, and about as many independent places as lines.
    """
    return float(scipy.special.chdtri(2 * n_function + 2, FALSE_ALARM / n_frequency))


def judge(frequency: NDArray[np.float64], fit: Fit, quantity: Quantity) -> Verdicts:
    """Measure every pole of a fit.

    Parameters
    ----------
    frequency : (n_frequency,) float
        Lines that were fitted, Hz.
    fit : Fit
    quantity : {"receptance", "mobility", "accelerance"}
        What was fitted.
    """
    covariance = fit.residue_covariance()
    n_function, n_mode = fit.residue.shape
    statistic, collinearity, realness, dominance = np.zeros((4, n_mode))
    exponent = DERIVATIVE[quantity]
    for r, pole in enumerate(fit.pole):
        block = covariance[:, 2 * r : 2 * r + 2, 2 * r : 2 * r + 2]
        parts = np.stack([fit.residue[:, r].real, fit.residue[:, r].imag], axis=1)
        statistic[r] = np.einsum("oi,oij,oj->", parts, np.linalg.pinv(block, hermitian=True), parts)

        constant = 2j * pole.imag * fit.residue[:, r]
        # Covariance of the constant's real and imaginary parts; multiplication by i swaps them.
        spread = (2.0 * pole.imag) ** 2 * np.array(
            [[block[:, 1, 1].sum(), -block[:, 0, 1].sum()], [-block[:, 0, 1].sum(), block[:, 0, 0].sum()]]
        )
        moment = np.array(
            [
                [np.sum(constant.real**2), np.sum(constant.real * constant.imag)],
                [np.sum(constant.real * constant.imag), np.sum(constant.imag**2)],
            ]
        )
        signal = moment - spread
        total = max(np.trace(signal), 0.0)
        if total > 0.0:
            distance = np.hypot(signal[0, 0] - signal[1, 1], 2.0 * signal[0, 1])
            collinearity[r] = min(1.0, (distance / total) ** 2)
            realness[r] = min(1.0, max(0.0, signal[0, 0] / total))

        s = 1j * pole.imag
        own = s**exponent * fit.residue[:, r] / (s - pole)
        everything = s**exponent * (
            fit.residue @ (1.0 / (s - fit.pole))
            + fit.residue.conj() @ (1.0 / (s - fit.pole.conj()))
            + fit.lower / s**2
            + fit.upper
        )
        with np.errstate(over="ignore", invalid="ignore"):  # residues of a pole that runs off know no bounds
            peak, rest = np.sum(np.abs(own) ** 2), np.sum(np.abs(everything - own) ** 2)
        if peak > 0.0 and np.isfinite(peak + rest):
            dominance[r] = np.sqrt(peak / max(rest, _NOTHING * peak))
    return Verdicts(
        statistic=statistic / variance_inflation(frequency, fit),
        threshold=significance_threshold(n_function, frequency.size),
        dominance=dominance,
        collinearity=collinearity,
        realness=realness,
    )


def variance_inflation(frequency: NDArray[np.float64], fit: Fit) -> NDArray[np.float64]:
    """Factor by which a misfit around each mode enlarges the variances, ``(n_mode,)``, 1 in white noise.

    The covariance of a fit holds for residuals without correlation from line to line. Around a mode that the
    model does not meet exactly (leakage, drift, nonlinearity) they are larger and smooth, and count as fewer.
    The factor is their spectral density in quefrency zero over the assumed one: local variance times
    ``1 + 2 sum_k rho_k``. It stays 1 where both the variance and the correlation are those of white noise.
    """
    return np.array([inflation(fit.whitened(_window(frequency, pole))) for pole in fit.pole])


def _window(frequency: NDArray[np.float64], pole: complex) -> slice:
    """Lines within four half bandwidths of a pole, or eight lines where that is more."""
    spacing = frequency[1] - frequency[0]
    centre = (pole.imag / (2.0 * np.pi) - frequency[0]) / spacing
    reach = max(4.0 * -pole.real / (2.0 * np.pi * spacing), 8.0)
    fewest = min(16, frequency.size)
    start = int(np.clip(centre - reach, 0, frequency.size - fewest))
    return slice(start, int(np.clip(centre + reach + 1, start + fewest, frequency.size)))


def inflation(residual: NDArray[np.complex128]) -> float:
    """Spectral density of unit-variance residuals ``(n_function, n_line)`` if it is significantly above 1."""
    n_function, n_line = residual.shape
    sample = n_function * n_line
    variance = float(np.mean(np.abs(residual) ** 2))
    spectrum = np.abs(scipy.fft.fft(residual, 2 * n_line, axis=1)) ** 2
    covariance = scipy.fft.ifft(spectrum.sum(axis=0)).real[: n_line // 2]
    correlation = covariance / covariance[0]
    if variance < 1.0 + 4.0 / np.sqrt(sample) and correlation[1] < 4.0 / np.sqrt(2.0 * sample):
        return 1.0
    # Beyond the first zero the correlation is noise.
    end = int(np.argmax(correlation <= 0.0)) or correlation.size
    return max(1.0, variance * (1.0 + 2.0 * float(correlation[1:end].sum())))


def likeliest_poles(frequency: NDArray[np.float64], fit: Fit) -> NDArray[np.complex128]:
    """Find poles that would explain most of what a fit has left, best first; none where nothing stands out.

    Lorentzian lines of octave-spaced widths are correlated with the residuals of all functions at once, which
    is the generalised likelihood ratio of one more mode, its residues free. What is left around such a line
    must then be smaller than the line, or it is one of the ripples of a misfit.

    Parameters
    ----------
    frequency : (n_frequency,) float
        Evenly spaced lines, Hz.
    fit : Fit
        A fit over these lines.

    Returns
    -------
    (n_pole,) complex
        At most one for each width, none within a half bandwidth of a fitted pole.
    """
    n_function, n = fit.residual.shape
    spacing = frequency[1] - frequency[0]
    scaled = fit.whitened()
    threshold = significance_threshold(n_function, n)
    size = scipy.fft.next_fast_len(2 * n)
    ones = scipy.fft.rfft(np.ones(n), size)
    offset = np.arange(size, dtype=float)
    offset[offset > size // 2] -= size
    widths = [width for width in 0.25 * 2.0 ** np.arange(64) if width < n / 8]
    powers = _correlated(scaled, [1.0 / (1.0 + 1j * offset / width) for width in widths])
    found: list[tuple[float, complex]] = []
    for width, power in zip(widths, powers, strict=True):
        line = 1.0 / (1.0 + 1j * offset / width)
        half_bandwidth = 2.0 * np.pi * spacing * width
        pole = -half_bandwidth + 2j * np.pi * frequency
        free = half_bandwidth < MAX_LINE_DAMPING * np.abs(pole)
        for old in fit.pole:
            free &= np.abs(pole.imag - old.imag) > np.maximum(half_bandwidth, -old.real)
        energy = scipy.fft.irfft(ones * scipy.fft.rfft(np.abs(line) ** 2), size)[:n]
        statistic = np.where(free, 2.0 * power / energy, 0.0)
        for _ in range(TRIES_PER_WIDTH):
            k = int(np.argmax(statistic))
            if statistic[k] <= threshold:
                break
            window = _window(frequency, pole[k])
            at = line[np.arange(n) - k]
            amplitude = scaled @ at.conj() / energy[k]
            rest = scaled[:, window] - amplitude[:, None] * at[window]
            inflated = statistic[k] / inflation(rest)
            if inflated > threshold and _collinear(amplitude) > 0.8 * MIN_COLLINEARITY:
                found.append((inflated, complex(pole[k])))
                break
            reach = int(np.ceil(2.0 * width))
            statistic[max(0, k - reach) : k + reach + 1] = 0.0
    found.sort(key=lambda pair: pair[0], reverse=True)
    return np.array([pole for _, pole in found], dtype=complex)


def _correlated(
    value: NDArray[np.complex128], lines: Sequence[NDArray[np.complex128]]
) -> NDArray[np.float64]:
    """Return the power of the correlation of functions with each of some lines, summed over the functions.

    Parameters
    ----------
    value : (n_function, n_frequency) complex
        Worked on some functions at a time, since transforms take several times their memory.
    lines : sequence of (size,) complex
        By their offset from the centre, wrapped; `size` is at least twice the number of frequencies.

    Returns
    -------
    (n_line, n_frequency) float
    """
    n, size = value.shape[1], lines[0].size if lines else 1
    transformed = [scipy.fft.fft(line).conj() for line in lines]
    power = np.zeros((len(lines), n))
    for start in range(0, len(value), BLOCK):
        spectrum = scipy.fft.fft(value[start : start + BLOCK], size, axis=1)
        for k, line in enumerate(transformed):
            power[k] += np.sum(np.abs(scipy.fft.ifft(spectrum * line, axis=1)[:, :n]) ** 2, axis=0)
    return power


def _collinear(amplitude: NDArray[np.complex128]) -> float:
    """Phase collinearity of amplitudes in noise of unit variance, which blurs the smallest of them."""
    power = np.sum(np.abs(amplitude) ** 2)
    return float(np.abs(np.sum(amplitude**2)) ** 2 / power**2) if power > 0.0 else 0.0


def is_split(fit: Fit, mode: int, others: Sequence[int] | None = None) -> bool:
    """Whether a pole shares the shape of another one, or of some, within its bandwidth: one mode taken for two."""
    mode %= fit.pole.size
    pole, own = fit.pole[mode], fit.residue[:, mode]
    for r in range(fit.pole.size) if others is None else others:
        other = fit.pole[r]
        if r != mode and np.abs(pole - other) < SPLIT_DISTANCE * -(pole.real + other.real):
            cross = np.abs(np.vdot(own, fit.residue[:, r])) ** 2
            if cross > SPLIT_MAC * np.sum(np.abs(own) ** 2) * np.sum(np.abs(fit.residue[:, r]) ** 2):
                return True
    return False


def is_confined(fit: Fit, run: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether each pole, ``(n_mode,)``, is a neighbour's image in a single roving run whose poles are shifted.

    Such a pole lies near another one and has most of its residues, in units of the noise, in one of at least
    three runs.
    """
    numbers = np.unique(run)
    confined = np.zeros(fit.pole.size, dtype=bool)
    if numbers.size < 3:
        return confined
    energy = np.abs(fit.residue / fit.noise[:, None]) ** 2
    share = np.stack([energy[run == n].sum(axis=0) for n in numbers]) / energy.sum(axis=0)
    for r in np.flatnonzero(share.max(axis=0) > CONFINED_SHARE):
        gap = np.abs(np.delete(fit.pole, r) - fit.pole[r])
        confined[r] = np.any(gap < NEIGHBOUR_DISTANCE * np.abs(fit.pole[r]))
    return confined
