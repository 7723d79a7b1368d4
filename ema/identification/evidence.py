"""What the choice of poles asks of the functions: whether a pole is a mode, and where a peak has none.

A mode must stand out of the noise of the measurement. That is necessary and, with measured data, not sufficient: a
small misfit of a strong mode is as significant as a weak mode. So a pole that does not dominate the response at its own
frequency must in addition look like a mode, that is have residues on one phase line. A pole that shares the shape of
its neighbour, or that one run alone needs, is no second mode.

Peaks that the functions show, or that stand in what the modes leave of them, are modes that are missing. Whether a pole
that is fitted to such a peak is one is asked on the lines around it (`objections`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from ema.identification.functions import MAX_DAMPING, Functions, inside
from ema.identification.maximum_likelihood import Fit
from ema.quality.peaks import peaks_of_any_width, peaks_over_noise
from ema.types.arrays import BLOCK
from ema.types.frf import DERIVATIVE, Quantity
from lamella_shared import Booleans, Complexes, Integers, Reals

FALSE_ALARM = 1e-4
"""Chance that noise alone brings forth a significant pole anywhere in the band."""
DOMINANT = 3.0
"""Peak over the rest of the response at resonance from which on a pole is a mode whatever its phases."""
MIN_COLLINEARITY, MIN_REALNESS = 0.9, 0.5
"""Least phase collinearity of the residues of a pole that does not dominate, and least share of its modal constants
along the real axis, where real modes have them."""
IN_PHASE = 0.8
"""Collinearity from which on points move alike, however turned against the force."""
SPLIT_DISTANCE = 2.0
"""Sums of half bandwidths within which two poles may be one mode."""
LEAST_SHARE, LEAST_ALONE = 0.1, 0.01
"""Share of a peak's power from which on it is unexplained, and that of a peak without a mode: the flanks of its
neighbours may add up to most of its power."""
LISTED = 0.3
"""Share left of a peak with a mode, or of one that is hidden between others, from which on it is reported."""
MANY_FUNCTIONS = 3
"""Functions from which on shapes and phases tell a mode from a second pole in the resonance of another one."""
EXPLAINS_LESS = "a mode there explains less than half of it"


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

    statistic: Reals
    threshold: float
    dominance: Reals
    collinearity: Reals
    realness: Reals

    @property
    def accepted(self) -> Booleans:
        """Which poles are modes, ``(n_mode,)``."""
        modal = (self.collinearity >= MIN_COLLINEARITY) & (self.realness >= MIN_REALNESS)
        return (self.statistic > self.threshold) & ((self.dominance >= DOMINANT) | modal)

    @property
    def score(self) -> Reals:
        """How much each pole looks like a mode, for taking the least likely one away first."""
        strength = np.minimum(1.0, self.statistic / self.threshold)
        return np.minimum(self.dominance, 1.0) * self.collinearity * strength


def significance_threshold(n_function: int, n_frequency: int, false_alarm: float = FALSE_ALARM) -> float:
    """Return the statistic that noise exceeds anywhere in the band with the probability of a false alarm.

    The pole itself is searched for: it adds two unknowns, and about as many independent places as lines.
    """
    return float(scipy.special.chdtri(2 * n_function + 2, false_alarm / n_frequency))


def judge(frequency: Reals, fit: Fit, quantity: Quantity) -> Verdicts:
    """Measure every pole of a fit over its lines, Hz, to functions of a quantity."""
    covariance = fit.covariance_of_each()
    n_function, n_mode = fit.residue.shape
    statistic, collinearity, realness, dominance = np.zeros((4, n_mode))
    exponent = DERIVATIVE[quantity]
    for r, pole in enumerate(fit.pole):
        block = covariance[:, r]
        parts = np.stack([fit.residue[:, r].real, fit.residue[:, r].imag], axis=1)
        statistic[r] = np.einsum("oi,oij,oj->", parts, np.linalg.pinv(block, hermitian=True), parts)

        constant = 2j * pole.imag * fit.residue[:, r]
        # Covariance of the constant's real and imaginary parts; multiplication by i swaps them.
        spread = (2.0 * pole.imag) ** 2 * np.array(
            [[block[:, 1, 1].sum(), -block[:, 0, 1].sum()], [-block[:, 0, 1].sum(), block[:, 0, 0].sum()]]
        )
        cross = np.sum(constant.real * constant.imag)
        moment = np.array([[np.sum(constant.real**2), cross], [cross, np.sum(constant.imag**2)]])
        signal = moment - spread
        total = max(np.trace(signal), 0.0)
        if total > 0.0:
            distance = np.hypot(signal[0, 0] - signal[1, 1], 2.0 * signal[0, 1])
            collinearity[r] = min(1.0, (distance / total) ** 2)
            realness[r] = min(1.0, max(0.0, signal[0, 0] / total))

        s = 1j * pole.imag
        alone = s**exponent * fit.residue[:, r] / (s - pole)
        everything = s**exponent * (
            fit.residue @ (1.0 / (s - fit.pole))
            + fit.residue.conj() @ (1.0 / (s - fit.pole.conj()))
            + fit.lower / s**2
            + fit.upper
        )
        with np.errstate(over="ignore", invalid="ignore"):  # residues of a pole that runs off know no bounds
            peak, rest = np.sum(np.abs(alone) ** 2), np.sum(np.abs(everything - alone) ** 2)
        if peak > 0.0 and np.isfinite(peak + rest):
            dominance[r] = np.sqrt(peak / max(rest, 1e-24 * peak))  # the peak may be all there is
    return Verdicts(
        statistic=statistic / variance_inflation(frequency, fit),
        threshold=significance_threshold(n_function, frequency.size),
        dominance=dominance,
        collinearity=collinearity,
        realness=realness,
    )


def variance_inflation(frequency: Reals, fit: Fit) -> Reals:
    """Return the factor by which a misfit around each mode enlarges the variances, ``(n_mode,)``, 1 in white noise.

    The covariance of a fit holds for residuals without correlation from line to line. Around a mode that the
    model does not meet exactly (leakage, drift, nonlinearity) they are larger and smooth, and count as fewer.
    The factor is their spectral density in quefrency zero over the assumed one: local variance times
    ``1 + 2 sum_k rho_k``. It stays 1 where both the variance and the correlation are those of white noise.
    """
    return np.array([inflation(fit.whitened(_window(frequency, pole))) for pole in fit.pole])


def _window(frequency: Reals, pole: complex) -> slice:
    """Lines within four half bandwidths of a pole, or eight lines where that is more."""
    spacing = frequency[1] - frequency[0]
    centre = (pole.imag / (2.0 * np.pi) - frequency[0]) / spacing
    reach = max(4.0 * -pole.real / (2.0 * np.pi * spacing), 8.0)
    fewest = min(16, frequency.size)
    start = int(np.clip(centre - reach, 0, frequency.size - fewest))
    return slice(start, int(np.clip(centre + reach + 1, start + fewest, frequency.size)))


def inflation(residual: Complexes, *, at_once: int = 1 << 18) -> float:
    """Spectral density of unit-variance residuals ``(n_function, n_line)`` if it is significantly above 1.

    `at_once`: values that are transformed at once; transforms take several times their memory.
    """
    n_function, n_line = residual.shape
    sample = n_function * n_line
    spectrum, few = np.zeros(2 * n_line), max(1, at_once // n_line)
    for first in range(0, n_function, few):
        some = residual[first : first + few]
        spectrum += (np.abs(scipy.fft.fft(some, 2 * n_line, axis=1)) ** 2).sum(axis=0)
    variance = float(spectrum.sum()) / (2 * n_line * sample)  # by Parseval's theorem
    covariance = scipy.fft.ifft(spectrum).real[: n_line // 2]
    correlation = covariance / covariance[0]
    # four standard deviations of either
    if variance < 1.0 + 4.0 / np.sqrt(sample) and correlation[1] < 4.0 / np.sqrt(2.0 * sample):
        return 1.0
    # Beyond the first zero the correlation is noise.
    end = int(np.argmax(correlation <= 0.0)) or correlation.size
    return max(1.0, variance * (1.0 + 2.0 * float(correlation[1:end].sum())))


def is_split(fit: Fit, mode: int, others: Sequence[int] | None = None, *, alike: float = 0.8) -> bool:
    """Whether a pole and another one, or one of some, within its bandwidth are one mode: a MAC says they are alike."""
    mode %= fit.pole.size
    pole, shape = fit.pole[mode], fit.residue[:, mode]
    for r in range(fit.pole.size) if others is None else others:
        other = fit.pole[r]
        if r != mode and np.abs(pole - other) < SPLIT_DISTANCE * -(pole.real + other.real):
            cross = np.abs(np.vdot(shape, fit.residue[:, r])) ** 2
            if cross > alike * np.sum(np.abs(shape) ** 2) * np.sum(np.abs(fit.residue[:, r]) ** 2):
                return True
    return False


def is_confined(fit: Fit, run: Integers, *, share: float = 0.8, distance: float = 0.02) -> Booleans:
    """Whether each pole, ``(n_mode,)``, is a neighbour's image in a single roving run whose poles are shifted.

    Such a pole lies near another one, within a relative distance, and has most of its residues, in units of the noise,
    in one of at least three runs: a share that a mode with sensors all over the structure does not have.
    """
    numbers = np.unique(run)
    confined = np.zeros(fit.pole.size, dtype=bool)
    if numbers.size < 3:
        return confined
    energy = np.abs(fit.residue / fit.noise[:, None]) ** 2
    of_run = np.stack([energy[run == n].sum(axis=0) for n in numbers]) / energy.sum(axis=0)
    for r in np.flatnonzero(of_run.max(axis=0) > share):
        gap = np.abs(np.delete(fit.pole, r) - fit.pole[r])
        confined[r] = np.any(gap < distance * np.abs(fit.pole[r]))
    return confined


def is_sound(fit: Fit, start: Complexes, band: tuple[float, float], *, max_move: float = 5.0) -> Booleans:
    """Tell which refined poles are determined by the data and stayed within some half bandwidths of their start.

    One that moves further was no estimate of that mode.
    """
    half_bandwidth = -fit.pole.real
    std = np.sqrt(np.diag(fit.pole_covariance)[1::2])
    moved = np.abs(fit.pole - start) > max_move * np.maximum(half_bandwidth, -start.real)
    determined = (std < half_bandwidth) & (half_bandwidth <= MAX_DAMPING * np.abs(fit.pole))
    return inside(fit.pole, band) & ~moved & determined


def likeliest_poles(frequency: Reals, fit: Fit, *, max_damping: float = 0.2, tries: int = 5) -> Complexes:
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
    max_damping : float
        Widest resonance, as a damping ratio.
    tries : int
        Places of each width that are looked at.

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
    correlated = _correlated(scaled, [1.0 / (1.0 + 1j * offset / width) for width in widths])
    likeliest: list[tuple[float, complex]] = []
    for width, power in zip(widths, correlated, strict=True):
        line = 1.0 / (1.0 + 1j * offset / width)
        half_bandwidth = 2.0 * np.pi * spacing * width
        pole = -half_bandwidth + 2j * np.pi * frequency
        free = half_bandwidth < max_damping * np.abs(pole)
        for old in fit.pole:
            free &= np.abs(pole.imag - old.imag) > np.maximum(half_bandwidth, -old.real)
        energy = scipy.fft.irfft(ones * scipy.fft.rfft(np.abs(line) ** 2), size)[:n]
        statistic = np.where(free, 2.0 * power / energy, 0.0)
        for _ in range(tries):
            k = int(np.argmax(statistic))
            if statistic[k] <= threshold:
                break
            window = _window(frequency, pole[k])
            at = line[np.arange(n) - k]
            amplitude = scaled @ at.conj() / energy[k]
            rest = scaled[:, window] - amplitude[:, None] * at[window]
            inflated = statistic[k] / inflation(rest)
            if inflated > threshold and _collinear(amplitude) > 0.8 * MIN_COLLINEARITY:  # noise blurs the phases
                likeliest.append((inflated, complex(pole[k])))
                break
            reach = int(np.ceil(2.0 * width))
            statistic[max(0, k - reach) : k + reach + 1] = 0.0
    likeliest.sort(key=lambda pair: pair[0], reverse=True)
    return np.array([pole for _, pole in likeliest], dtype=complex)


def _correlated(value: Complexes, lines: Sequence[Complexes]) -> Reals:
    """Return the power of the correlation of functions with some lines, all functions, ``(n_line, n_frequency)``.

    Lines, ``(size,)`` each, are by their offset from the centre, wrapped; `size` is at least twice the number of
    frequencies. Functions are taken some at a time, since transforms take several times their memory.
    """
    n, size = value.shape[1], lines[0].size if lines else 1
    transformed = [scipy.fft.fft(line).conj() for line in lines]
    power = np.zeros((len(lines), n))
    for start in range(0, len(value), BLOCK):
        spectrum = scipy.fft.fft(value[start : start + BLOCK], size, axis=1)
        for k, line in enumerate(transformed):
            power[k] += np.sum(np.abs(scipy.fft.ifft(spectrum * line, axis=1)[:, :n]) ** 2, axis=0)
    return power


def _collinear(amplitude: Complexes) -> float:
    """Phase collinearity of amplitudes in noise of unit variance, which blurs the smallest of them."""
    power = np.sum(np.abs(amplitude) ** 2)
    return float(np.abs(np.sum(amplitude**2)) ** 2 / power**2) if power > 0.0 else 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Peak:
    """A peak that the modes leave unexplained.

    Attributes
    ----------
    line : int
        Line of its largest value.
    frequency : float
        Its frequency, Hz.
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
    left: Reals
    visible: bool

    @property
    def window(self) -> slice:
        """Its lines."""
        return slice(self.first, self.last + 1)

    @property
    def half_width(self) -> float:
        """Half of its width, lines."""
        return max(0.5 * (self.last - self.first), 0.5)


Left = tuple[tuple[Peak, str], ...]
"""Peaks that stay unexplained, each with the reason why."""


def powers(data: Functions, fit: Fit) -> tuple[Reals, Reals, Reals]:
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


def left_of_functions(data: Functions, fit: Fit, window: slice) -> Reals:
    """Share of the power of each function, (n_function,), that a fit leaves on some lines."""
    rest, each = (np.sum(np.abs(value[:, window]) ** 2, axis=1) for value in (fit.residual, data.value))
    return np.asarray(rest / each)


def left_at_poles(data: Functions, fit: Fit, *, fewest_lines: float = 1.5) -> Reals:
    """Share of the power that a fit leaves in the half bandwidths around each of its poles, ``(n_mode,)``."""
    each, rest, _ = powers(data, fit)
    spacing = float(data.frequency[1] - data.frequency[0])
    reach = np.maximum(-fit.pole.real / (2.0 * np.pi), fewest_lines * spacing)
    near = np.abs(data.frequency - fit.pole.imag[:, None] / (2.0 * np.pi)) <= reach[:, None]
    return np.asarray((near @ rest) / np.maximum(near @ each, np.finfo(float).tiny))


def holds_pole(data: Functions, fit: Fit, peak: Peak) -> bool:
    """Whether one of the fitted poles lies in a peak."""
    spacing = float(data.frequency[1] - data.frequency[0])
    distance = np.abs(fit.pole.imag / (2.0 * np.pi) - peak.frequency)
    return bool(np.any(distance <= spacing * max(peak.half_width, 1.0)))


def unexplained_peaks(
    data: Functions, fit: Fit, *, visible_dB: float = 1.0, hidden_dB: float = 3.0, least_hidden: float = 0.2
) -> list[Peak]:
    """Find the peaks of which a fit leaves more than noise, the largest first.

    These are the peaks of the functions' summed power, as measured and with each function over its mean, and those of
    what is left of it: a mode between two others may be no more than a shoulder. Functions over their mean show a mode
    of which most of them have little, and their plain sum one that is strong in a few of which the mean is large.

    Parameters
    ----------
    data : Functions
    fit : Fit
    visible_dB, hidden_dB : float
        Height over the valleys beside it from which on anyone sees a peak of the summed power, and that of a peak of
        what is left.
    least_hidden : float
        Least share left where only what is left has a peak: less is a misfit of the modes beside it.
    """
    power, left, plain = powers(data, fit)
    seen = [(*lines, True) for summed in (power, plain) for lines in peaks_of_any_width(summed, visible_dB)]
    hidden = [(*lines, False) for lines in peaks_over_noise(left, hidden_dB)]
    peaks: list[Peak] = []
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
        least = LEAST_ALONE if alone else LEAST_SHARE if visible else least_hidden
        known = any(other.first <= line <= other.last for other in peaks)
        if not known and peak.share > least:
            peaks.append(peak)
    return sorted(peaks, key=lambda peak: -left[peak.line])


class Refusal(NamedTuple):
    """Why a peak is not taken in as a mode, and the share of its power that makes it one to report.

    The share is what the modes leave in the end; it is infinite where the peak is noise.
    """

    reason: str
    least: float = LEAST_ALONE


class Surroundings(NamedTuple):
    """The lines around a peak, fitted with the modes that are near."""

    lines: slice  # which ones
    target: Functions  # on these lines, less the response of the modes that are not near
    near: Booleans  # (n_mode,), which modes of the whole fit are
    without: Fit  # of the target with these alone


def objections(
    data: Functions,
    around: Surroundings,
    extended: Fit,
    peak: Peak,
    band: tuple[float, float],
    *,
    false_alarm: float = 1e-3,
    far_from_noise: float = 2.0,
    many_functions: int = 8,
    rough: tuple[float, float] = (0.5, 0.8),
    resolved_lines: float = 4.0,
    most_left: float = 0.5,
) -> Iterator[Refusal]:
    """Say what speaks against the last pole of a fit of the lines around a peak, the weightiest first.

    Parameters
    ----------
    data : Functions
    around : Surroundings
        The lines around the peak, fitted without the pole.
    extended : Fit
        The same lines with it.
    peak : Peak
    band : (float, float)
        Where modes are wanted, Hz.
    false_alarm : float
        Chance that noise around a peak brings forth a pole in it.
    far_from_noise : float
        Thresholds of the likelihood within which a peak that is not taken in is noise and not listed.
    many_functions, rough : int and (float, float)
        Functions from which on phases with such a collinearity and realness are no chance where a peak is seen; random
        ones reach 0.1, 0.5.
    resolved_lines : float
        Lines in a half bandwidth from which on a peak that is a pole's in as many functions, to `LEAST_SHARE` of its
        power, is a resonance whichever way its residues are turned: by cross-talk, filters or a misplaced force.
    most_left : float
        Share of what was unexplained of a peak that may be left when its mode is taken in.
    """
    n_function = extended.residue.shape[0]
    new = complex(extended.pole[-1])
    frequency = around.target.frequency
    spacing = 2.0 * np.pi * float(data.frequency[1] - data.frequency[0])
    apart = np.abs(extended.pole.imag - 2.0 * np.pi * peak.frequency)
    gain = 2.0 * (around.without.objective - extended.objective)
    threshold = significance_threshold(n_function, frequency.size, false_alarm)
    verdicts = judge(frequency, extended, data.quantity)
    collinearity, realness = verdicts.collinearity[-1], verdicts.realness[-1]
    left = share_left(data, around, extended, peak)
    far = gain > far_from_noise * threshold
    correlated = threshold * inflation(extended.whitened())
    if gain < correlated:
        brought = f"the {0.5 * correlated:.3g} that noise may bring"
        yield Refusal(f"the likelihood rises by {0.5 * gain:.3g} of {brought}", LEAST_ALONE if far else np.inf)
    if verdicts.statistic[-1] < verdicts.threshold:
        # Where both the summed power and the likelihood stand out of the noise, each function need not.
        yield Refusal(
            "its residues do not stand out of the noise", LEAST_ALONE if far else least_listed(peak, LEAST_SHARE)
        )
    if apart[-1] > spacing * max(2.0 * peak.half_width, 1.0):
        yield Refusal("no pole of the fit comes to rest there")
    alike = collinearity >= rough[0] and realness >= rough[1]
    alike |= -new.real > resolved_lines * spacing and left < LEAST_SHARE and collinearity >= rough[0]
    # Rough phases do where the peak is clear: seen in many functions, beside no other pole.
    old, clear = extended.pole[:-1], n_function >= many_functions and (peak.visible or peak.share > LISTED)
    alone = clear and bool(np.all(np.abs(old - new) > -SPLIT_DISTANCE * (old.real + new.real)))
    modal = collinearity >= MIN_COLLINEARITY and realness >= MIN_REALNESS
    phased = modal or (alike and alone) or (clear and _alike_on_flanks(around, extended))
    if n_function >= MANY_FUNCTIONS and not phased:
        yield Refusal(_of_phases(extended.residue[:, -1], new, collinearity))
    if not inside(extended.pole, band)[-1]:
        yield Refusal("its bandwidth reaches beyond the band")
    std = float(np.sqrt(extended.pole_covariance[-1, -1]))
    seen = peak.visible and left < LEAST_SHARE
    if -new.real > MAX_DAMPING * abs(new) or (std > -new.real and not seen) or is_one_line(new, data.frequency):
        yield Refusal("its damping is not determined")
    if np.any(apart[:-1] < apart[-1]):
        yield Refusal("one resonance that is not that of a linear mode: a second pole takes its misfit")
    if _is_double(extended, spacing):
        yield Refusal("one resonance fitted twice: its shape is that of the mode beside it")
    if is_confined(extended, data.run)[-1]:
        yield Refusal("it is seen in one run only, beside a mode that is elsewhere there")
    if left > max(most_left * peak.share, LEAST_SHARE):
        yield Refusal(EXPLAINS_LESS)


def is_one_line(pole: complex | Complexes, frequency: Reals, *, narrowest: float = 0.02) -> Booleans:
    """Tell which poles are so near one line (Hz) that it holds all their power: a line out of place is fitted so.

    A resonance as narrow that lies between two lines has flanks in both, and in those beside them. `narrowest`:
    distance of one that is not, lines.
    """
    place = (np.asarray(pole) / 2j / np.pi - frequency[0]) / (frequency[1] - frequency[0])
    return np.asarray(np.abs(place - np.round(place.real)) < narrowest)


def _of_phases(residue: Complexes, pole: complex, collinearity: float) -> str:
    """Say what is wrong with the phases of residues: against each other, or all together against the force."""
    reason = "its residues have not the phases of a mode"
    if collinearity < IN_PHASE:
        return reason
    constant = 2j * pole.imag * residue
    angle = float(np.degrees(abs(np.angle(np.sum(constant**2)) / 2.0)))
    return f"{reason}: alike among points, but turned by {angle:.0f} degrees against the force, as by filters or delays"


def least_listed(peak: Peak, share: float) -> float:
    """Share from which on a peak is listed whose power must have been left by so much, when it was tried or is now."""
    of_visible = LEAST_ALONE if peak.share > share else share
    return of_visible if peak.visible else np.inf


def _alike_on_flanks(around: Surroundings, extended: Fit) -> bool:
    """Whether points move alike in the last pole where lines weigh by the misfit, as the flanks of a peak then do."""
    lines = around.target  # a record that ends before its resonance spoils the phases of the peak's own lines alone
    judged = judge(lines.frequency, lines.weigh_by_misfit(extended), lines.quantity)
    return bool(judged.collinearity[-1] >= IN_PHASE)


def _is_double(fit: Fit, spacing: float, *, leakage: float = 2.5) -> bool:
    """Whether the last pole shares the shape of one within its bandwidth; of few functions, whether it is as near.

    A resonance that is narrower than the spacing of the lines (rad/s) leaks into so many beside it.
    """
    if fit.residue.shape[0] >= MANY_FUNCTIONS:
        return is_split(fit, -1)
    old, new = fit.pole[:-1], fit.pole[-1]
    reach = np.maximum(0.5 * np.maximum(-old.real, -new.real), leakage * spacing)
    return bool(np.any(np.abs(old.imag - new.imag) < reach))


def share_left(data: Functions, around: Surroundings, local: Fit, peak: Peak) -> float:
    """Share of the power of a peak that a fit of the lines around it leaves."""
    size = np.mean(np.abs(data.value) ** 2, axis=1, keepdims=True)
    first, stop = max(peak.first - around.lines.start, 0), peak.last + 1 - around.lines.start
    left = np.sum(np.abs(local.residual[:, first:stop]) ** 2 / size)
    whole = np.sum(np.abs(data.value[:, around.lines][:, first:stop]) ** 2 / size)
    return float(left / whole)
