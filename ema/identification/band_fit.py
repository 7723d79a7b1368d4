"""All modes of a band fitted: at once, run by run where runs differ, and in parts where it has very many lines.

Spikes: tests of likelihood hold for noise that is normal and even. Where the force has no power left, or a joint
rattles, a band is full of single high lines, and the highest of them look like narrow modes. What the modes leave in
the surroundings tells: a mode stands alone above it, a spike is one of several that are as high. Peaks that are left
on the flanks of modes are no noise but a misfit of these: beside a strong mode a weak one is lower than such, and is a
mode.

Overlap: where bandwidths reach over several modes, poles are found that the functions need, but whose residues have
not the phases of a mode: each stands for several modes. Taken away one after the other, each spoils the phases of its
neighbours, until those that can be separated go as well. So they stay in the fit, as background, and are no results.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
import scipy.linalg

from ema.identification.evidence import (
    LEAST_SHARE,
    Left,
    Peak,
    holds_pole,
    is_one_line,
    is_sound,
    is_split,
    judge,
    left_at_poles,
    powers,
    unexplained_peaks,
)
from ema.identification.functions import (
    MAX_DAMPING,
    Functions,
    PartBand,
    coherence_weight,
    inside,
    part_bands,
    resonant,
    response,
)
from ema.identification.maximum_likelihood import Fit, linear_fit, refine
from ema.identification.run_poles import RunPoles, run_poles
from ema.identification.run_tracking import follow_runs, runs_apart
from ema.identification.selection import fit_chosen, select_modes, settled
from ema.identification.stabilization import stabilization
from ema.types.frf import FRF
from lamella_shared import Booleans, Complexes, Integers, Reals

AS_HIGH, SEVERAL = 0.8, 3
"""Share of a pole's statistic, noise deducted, from which on a peak is as high, and how many such make it common."""


def is_common(
    data: Functions,
    fit: Fit,
    *,
    left: float = 0.3,
    surroundings: tuple[float, int] = (40.0, 400),
    flanks: tuple[float, int] = (4.0, 3),
) -> Booleans:
    """Whether what is left around each pole, ``(n_mode,)``, has several peaks that are as high as the pole itself.

    The measure of both is the generalised likelihood ratio of a line as wide as the pole's, its residues free. A pole
    that is not higher than the median of what is left is none either.

    Parameters
    ----------
    data : Functions
        Evenly spaced lines.
    fit : Fit
        A fit of them.
    left : float
        Power that is left around a line over that of the modes there, from which on it is noise and not their misfit.
    surroundings : (float, int)
        Half bandwidths on each side of a pole that are its surroundings, and least number of lines.
    flanks : (float, int)
        Half bandwidths around each pole that are left out, and lines beyond these: what is left there is misfit.
    """
    frequency = data.frequency
    spacing = float(frequency[1] - frequency[0])
    place = (np.abs(fit.pole) / (2.0 * np.pi) - frequency[0]) / spacing
    half = -fit.pole.real / (2.0 * np.pi * spacing)
    excluded = np.ceil(flanks[0] * half) + flanks[1]
    common = np.zeros(fit.pole.size, dtype=bool)
    for r, (centre, width) in enumerate(zip(place, half, strict=True)):
        reach = int(max(surroundings[0] * width, surroundings[1]))
        start, stop = max(0, int(centre) - reach), min(frequency.size, int(centre) + reach + 1)
        if not start <= centre < stop:
            continue  # beyond the band
        lines = slice(start, stop)
        sums = _around_pole(data, fit, r, lines, width)
        number = np.arange(start, stop)
        free = np.all(np.abs(number[:, None] - place) > excluded, axis=1)
        if not free.any():
            continue
        lost = free & (sums.left > left * sums.modes)
        floor = float(np.median(sums.noise[free]))
        k = int(np.clip(np.round(centre), start, stop - 1)) - start
        peak = float(np.max(sums.whole[max(0, k - 2) : k + 3])) - floor
        high = _number_of_peaks(np.where(lost, sums.noise - floor, 0.0), AS_HIGH * peak, int(excluded[r]))
        common[r] = peak <= 0.0 or high >= SEVERAL
    return common


@dataclass(kw_only=True)
class _Sums:
    """What all functions together hold on the lines around a pole, `(n_line,)` each."""

    left: Reals  # power that the fit leaves
    modes: Reals  # power that it explains
    noise: Reals  # likelihood of a line as wide as the pole's in what is left
    whole: Reals  # the same with the pole itself


def _around_pole(data: Functions, fit: Fit, r: int, lines: slice, width: float, *, at_once: int = 1 << 19) -> _Sums:
    """Add up the functions, some at a time: all at once would take several times their memory.

    `at_once`: values of functions that are transformed at once.
    """
    frequency = data.frequency[lines]
    around = replace(data, frequency=frequency)
    sums = _Sums(**{name: np.zeros(frequency.size) for name in ("left", "modes", "noise", "whole")})
    few = max(1, at_once // (2 * frequency.size))  # transforms have twice the lines
    for first in range(0, len(data.value), few):
        rows = slice(first, first + few)
        scale = np.sqrt(fit.weight[rows, lines]) / fit.noise[rows, None]
        left = fit.residual[rows, lines] * scale
        sums.left += _power(left, width)
        sums.modes += _power((data.value[rows, lines] - fit.residual[rows, lines]) * scale, width)
        sums.noise += _line_statistic(left, width)
        mode = response(around, fit.pole[[r]], fit.residue[rows][:, [r]])
        sums.whole += _line_statistic(left + mode * scale, width)
    return sums


def _power(scaled: Complexes, half: float) -> Reals:
    """Power of all functions about every line, the mean over as many as a half bandwidth (lines) on each side."""
    power: Reals = scipy.ndimage.uniform_filter1d(np.sum(np.abs(scaled) ** 2, axis=0), 2 * round(half) + 3)
    return power


def _line_statistic(scaled: Complexes, half: float, *, narrowest: float = 0.25) -> Reals:
    """Twice the gain of likelihood by a resonance line of a half bandwidth (lines) at every line, ``(n_line,)``.

    `narrowest`: half bandwidth of a matched line, lines.
    """
    n = scaled.shape[1]
    size = scipy.fft.next_fast_len(2 * n)
    offset = np.arange(size, dtype=float)
    offset[offset > size // 2] -= size
    line = 1.0 / (1.0 + 1j * offset / max(half, narrowest))
    spectrum = scipy.fft.fft(scaled, size, axis=1) * scipy.fft.fft(line).conj()
    total = np.sum(np.abs(scipy.fft.ifft(spectrum, axis=1)[:, :n]) ** 2, axis=0)
    square = scipy.fft.rfft(np.abs(line) ** 2)
    energy = scipy.fft.irfft(scipy.fft.rfft(np.ones(n), size) * square, size)[:n]
    return np.asarray(2.0 * total / energy)


def _number_of_peaks(statistic: Reals, least: float, apart: int) -> int:
    """Count places at which a statistic exceeds a value, no two nearer than so many lines; `SEVERAL` are enough."""
    rest = statistic.copy()
    for number in range(SEVERAL):
        k = int(np.argmax(rest))
        if rest[k] <= max(least, 0.0):
            return number
        rest[max(0, k - apart) : k + apart + 1] = 0.0
    return SEVERAL


OVERLAPPED = "modes overlap there so much that they cannot be told apart"


def modal_overlap(pole: Complexes) -> float:
    """Return the modal overlap factor: the median half-power bandwidth over the mean spacing of the poles."""
    return float(-2.0 * np.median(pole.real) * pole.size / np.ptp(pole.imag)) if pole.size > 1 else 0.0


def with_background(
    data: Functions, candidates: Complexes, band: tuple[float, float], *, undamped: float = 1e-6
) -> tuple[Fit, Booleans]:
    """Refine candidates together, and tell which are modes.

    Parameters
    ----------
    data : Functions
    candidates : (n_candidate,) complex
        Poles that may be modes, rad/s.
    band : (float, float)
        Where modes are wanted, Hz.
    undamped : float
        Least damping ratio of a pole that is needed.

    Returns
    -------
    fit : Fit
        All poles that stand out of the noise.
    is_mode : (n_mode,) bool
        Which of them are modes; the others are background.
    """
    pole, wide = candidates, (2.0 * band[0] - band[1], 2.0 * band[1] - band[0])
    while True:
        fit = refine(data.frequency, data.value, pole, data.quantity)
        verdicts = judge(data.frequency, fit, data.quantity)
        size = np.abs(fit.pole)
        damped = (-fit.pole.real > undamped * size) & (-fit.pole.real < MAX_DAMPING * size)
        needed = (verdicts.statistic > verdicts.threshold) & damped & inside(fit.pole, wide)
        if needed.all():
            break
        pole = fit.pole[needed]
    is_mode = needed & verdicts.accepted & is_sound(fit, pole, band)
    return fit, is_mode & ~_doubles(fit, is_mode)


def _doubles(fit: Fit, is_mode: Booleans, *, same_place: float = 0.1) -> Booleans:
    """Tell which modes are no more than a second pole of a stronger one: of its shape, or at its very place.

    `same_place`: half bandwidths within which two poles are at one place: runs that differ a little bring such.
    """
    double = np.zeros(fit.pole.size, dtype=bool)
    height = np.linalg.norm(fit.residue, axis=0) / -fit.pole.real
    kept: list[int] = []
    for r in sorted(np.flatnonzero(is_mode), key=lambda r: -height[r]):
        half = np.minimum(-fit.pole.real[kept], -fit.pole.real[r])
        double[r] = is_split(fit, int(r), kept) or bool(
            np.any(np.abs(fit.pole.imag[kept] - fit.pole.imag[r]) < same_place * half)
        )
        if not double[r]:
            kept.append(int(r))
    return double


_COMMON = "what is left beside it has several peaks as high, as noise or a rattle brings"
_LOST = "a mode that all runs together show there is lost where each run has poles of its own"
_OF_MODES = ("variance", "frequency_std", "damping_std", "enlargement", "probability")


@dataclass(frozen=True, eq=False, kw_only=True)
class BandFit:
    """The modes of a band.

    Attributes
    ----------
    value : (n_output, n_input, n_frequency) complex
        What was fitted: the functions, those of runs that differ moved to common poles (`run_tracking`).
    fit : Fit
        All modes together, those within the band first and ascending in frequency.
    runs : RunPoles
        The same poles run by run.
    left : tuple of (Peak, str)
        Peaks that stay unexplained.
    n_background : int
        Poles, the last of the fit, that are no modes though they lie in the band (`ema.identification.overlap`).
    """

    value: Complexes
    fit: Fit
    runs: RunPoles
    left: Left
    n_background: int = 0


def fit_band(frf: FRF, order: int, chosen: Complexes | None, band: tuple[float, float]) -> BandFit:
    """Find and fit the modes of a band, or fit poles that were chosen by hand.

    Parameters
    ----------
    frf : FRF
        Functions of even noise on the lines of the band.
    order : int
        Highest model order.
    chosen : (n_mode,) complex, optional
        Poles chosen by hand, rad/s; they are found where not given.
    band : (float, float)
        Where modes are wanted, Hz.
    """
    parts = part_bands(frf.value)
    if len(parts) == 1:
        whole = _fit_at_once(frf, order, chosen, band)
        return whole if chosen is not None else _amid_overlap(frf, order, whole, band)
    ends = [band[0], *(float(frf.frequency[part.core.start]) for part in parts[1:]), band[1]]
    fits: list[BandFit] = []
    weights: list[Reals] = []
    for part, lower, upper in zip(parts, ends[:-1], ends[1:], strict=True):
        lines = frf.frequency[part.lines]
        chosen_there = None if chosen is None else chosen[_between(chosen, lower, upper)]
        around = (min(lower, float(lines[0])), max(upper, float(lines[-1])))
        one = _fit_at_once(frf.band(lines[0], lines[-1]), order, chosen_there, around)
        own_lines = part.of(one.fit.weight)
        weights.append(own_lines / one.fit.noise[:, None] ** 2)
        fits.append(replace(one, fit=_without_lines(one.fit)))
        del one, own_lines  # large, and not to be held beside the next part
    return _joined(frf, parts, ends, fits, weights)


def _fit_at_once(frf: FRF, order: int, chosen: Complexes | None, band: tuple[float, float]) -> BandFit:
    data = _functions(frf)
    if chosen is not None:
        fit, runs, left = fit_chosen(data, chosen, band)
        return BandFit(value=frf.value, fit=fit, runs=runs, left=left)
    fit, runs, left = select_modes(data, stabilization(frf, order=order).chosen, band)
    result = BandFit(value=frf.value, fit=fit, runs=runs, left=left)
    followed = (
        follow_runs(frf, data, order, band, fit)
        if resonant(fit.pole, band).any() and runs_apart(fit, runs, left, band)
        else None
    )
    if followed is not None:
        value = followed.value.reshape(frf.value.shape)
        result = with_lost_peaks(
            frf, BandFit(value=value, fit=followed.fit, runs=followed.runs, left=followed.left), result, _LOST
        )
    return with_lost_peaks(frf, _without_common(frf, result), result, _COMMON)


def _amid_overlap(
    frf: FRF, order: int, first: BandFit, band: tuple[float, float], *, overlap: float = 0.3, little: float = 1e-3
) -> BandFit:
    """Find the modes again amid others that overlap too much to be separated, where a fit without these fails.

    The background is taken out of the functions while modes are judged and sought; in the end all is fitted together.

    `overlap`: modal overlap factor from which modes are sought beside background.
    `little`: share of the power that may be left where modes overlap, before they are sought anew beside poles that
    are none.
    """
    data = _functions(frf)
    candidates = stabilization(frf, order=order).chosen
    before = _left(_functions(replace(frf, value=first.value)), first.fit)
    if modal_overlap(candidates) < overlap or before < little:
        return first
    whole, is_mode = with_background(data, candidates, band)
    if is_mode.all() or not is_mode.any():
        return first
    background = response(data, whole.pole[~is_mode], whole.residue[:, ~is_mode])
    fit, runs, _ = fit_chosen(replace(data, value=data.value - background), whole.pole[is_mode], band)
    pole = np.append(fit.pole, whole.pole[~is_mode])
    joint = data.linear_fit(pole, fit.weight)
    n_mode, n_before = (np.count_nonzero(resonant(one.pole, band)) for one in (fit, first.fit))
    if n_mode <= n_before or _left(data, joint) > before:
        return first
    hidden = replace(fit, residual=fit.residual + background)
    left = tuple(
        (peak, OVERLAPPED)
        for peak in unexplained_peaks(data, hidden)
        if peak.visible and not holds_pole(data, hidden, peak)
    )
    n_background = int(np.count_nonzero(~is_mode))
    return BandFit(
        value=frf.value, fit=joint, runs=runs.beside(joint, n_background), left=left, n_background=n_background
    )


def _left(data: Functions, fit: Fit) -> float:
    """Return the share of the power that a fit leaves, the mean over functions."""
    each, rest, _ = powers(data, fit)
    return float(rest.sum() / each.sum())


def with_lost_peaks(frf: FRF, result: BandFit, before: BandFit, reason: str) -> BandFit:
    """List the peaks that had a pole before, or were listed, and have none now."""
    data = _functions(replace(frf, value=result.value))
    earlier = _functions(replace(frf, value=before.value))
    left = [*result.left]
    for peak in unexplained_peaks(data, result.fit):
        if holds_pole(data, result.fit, peak) or any(_overlap(peak, p) for p, _ in left):
            continue
        why = [said for other, said in before.left if _overlap(peak, other)]
        if why or holds_pole(earlier, before.fit, peak):
            left.append((peak, why[0] if why else reason))
    return replace(result, left=tuple(left))


def _overlap(peak: Peak, other: Peak) -> bool:
    """Whether two peaks share a line."""
    return peak.first <= other.last and other.first <= peak.last


def _without_common(frf: FRF, given: BandFit) -> BandFit:
    """Take away poles beside which peaks as high are left, and those whose damping ran to 0 in the last fit.

    Runs that differ leave such peaks of the strongest modes, too, until they are followed: so this comes last. Where
    it is the misfit of strong modes that is as high, lines weigh by that misfit.
    """
    data = _functions(replace(frf, value=given.value))
    result = _weighed(data, given)
    while (common := _is_common_anyhow(data, result.fit) | is_one_line(result.fit.pole, data.frequency)).any():
        kept = np.flatnonzero(~common)
        pairs = (2 * kept[:, None] + np.arange(2)).reshape(-1)
        covariance = result.fit.pole_covariance[np.ix_(pairs, pairs)]
        fit = linear_fit(data.frequency, data.value, result.fit.pole[kept], data.quantity, result.fit.weight)
        runs = {name: getattr(result.runs, name)[..., kept] for name in ("pole", "residue", *_OF_MODES)}
        result = replace(result, fit=replace(fit, pole_covariance=covariance), runs=replace(result.runs, **runs))
    return result


def _is_common_anyhow(data: Functions, fit: Fit) -> Booleans:
    """Tell which poles are common however lines weigh: with all alike, too."""
    common = is_common(data, fit)
    return common & is_common(data, data.linear_fit(fit.pole)) if common.any() else common


def _weighed(data: Functions, given: BandFit) -> BandFit:
    """Weigh lines by the misfit where poles come to explain their peaks, and to stand alone, by that and not without.

    The misfit of much stronger modes takes the residues of weak ones, and what it leaves is as high as they are.
    """
    common = is_common(data, given.fit)
    hungry = common & (left_at_poles(data, given.fit) > LEAST_SHARE)
    if not hungry.any() or given.runs.followed:
        return given
    fit = settled(data, data.weigh_by_misfit(given.fit))
    order = np.abs(given.fit.pole[:, None] - fit.pole).argmin(axis=1)
    fit = data.linear_fit(fit.pole[order], fit.weight)
    still = is_common(data, fit)
    better = hungry & ~still & (left_at_poles(data, fit) < LEAST_SHARE)
    if fit.objective >= given.fit.objective or not better.any() or (still & ~common).any():
        return given
    return replace(given, fit=fit, runs=run_poles(data, fit))


def _between(pole: Complexes, lower: float, upper: float) -> Booleans:
    hertz = np.abs(pole) / (2.0 * np.pi)
    return (hertz >= lower) & (hertz < upper)


def _joined(
    frf: FRF, parts: tuple[PartBand, ...], ends: list[float], fits: list[BandFit], weights: list[Reals]
) -> BandFit:
    """Put the modes of the parts together: poles and their scatter as each part gives them, residues of all at once.

    Beyond the band are what the first part has below it and the last one above. Lines weigh by the noise of their part:
    `weights` holds those of each, and is empty afterwards.
    """
    lower, upper = [0.0, *ends[1:-1]], [*ends[1:-1], np.inf]
    kept = [np.flatnonzero(_between(one.fit.pole, a, b)) for one, a, b in zip(fits, lower, upper, strict=True)]
    pole = np.concatenate([one.fit.pole[r] for one, r in zip(fits, kept, strict=True)])
    rank = np.lexsort((np.abs(pole), ~resonant(pole, (ends[0], ends[-1]))))
    pairs = (2 * rank[:, None] + np.arange(2)).reshape(-1)
    followed = any(one.runs.followed for one in fits)
    value = (
        np.concatenate([part.of(one.value) for part, one in zip(parts, fits, strict=True)], axis=-1)
        if followed
        else frf.value
    )
    weight = np.concatenate(weights, axis=-1)
    weights.clear()  # large
    for row in weight:
        np.divide(row, np.exp(np.mean(np.log(row))), out=row)
    data = _functions(replace(frf, value=value))
    fit = linear_fit(data.frequency, data.value, pole, data.quantity, weight, with_residual=False)
    owner = np.repeat(np.arange(len(parts)), [r.size for r in kept])
    pole, covariance = _beside_others(data, fit, parts, owner)
    fit = linear_fit(data.frequency, data.value, pole[rank], data.quantity, weight, with_residual=False)

    def of_runs(name: str) -> Reals:
        columns = [getattr(one.runs, name)[..., r] for one, r in zip(fits, kept, strict=True)]
        return np.concatenate(columns, axis=-1)[..., rank]

    return BandFit(
        value=value,
        fit=replace(fit, pole_covariance=covariance[np.ix_(pairs, pairs)]),
        runs=RunPoles(
            run=fits[0].runs.run,
            pole=np.asarray(of_runs("pole"), dtype=complex),
            residue=np.asarray(of_runs("residue"), dtype=complex),
            followed=followed,
            **{name: of_runs(name) for name in _OF_MODES},
        ),
        left=tuple(
            (peak, reason)
            for one, a, b in zip(fits, lower, upper, strict=True)
            for peak, reason in one.left
            if a <= peak.frequency < b
        ),
    )


def _without_lines(fit: Fit) -> Fit:
    """Return a fit without what it holds of every line, for that is large and not asked for any more."""
    none = np.empty((len(fit.residual), 0))
    return replace(fit, residual=none.astype(complex), weight=none)


def _beside_others(data: Functions, fit: Fit, parts: tuple[PartBand, ...], owner: Integers) -> tuple[Complexes, Reals]:
    """Refine the poles of each part once more, on its lines less what the modes of the other parts answer there.

    In the fit of one part alone its residual terms stand for those modes, which moves poles by a standard deviation.
    """
    pole = fit.pole.copy()
    covariance = []
    for k, part in enumerate(parts):
        members = owner == k
        pole[members], one = _refined(data, fit, part, members)
        covariance.append(one)
    return pole, scipy.linalg.block_diag(*covariance)


def _refined(
    data: Functions, fit: Fit, part: PartBand, members: Booleans, *, strays: float = 0.5
) -> tuple[Complexes, Reals]:
    """Return the poles of one part, which are its `members` of all, and their covariance.

    `strays`: half bandwidths that a pole of one part may move when the modes of the others are taken out; no part
    moves then.
    """
    lines = replace(data, frequency=data.frequency[part.lines], value=data.value[:, part.lines])
    rest = response(lines, fit.pole[~members], fit.residue[:, ~members])
    np.subtract(lines.value, rest, out=rest)
    weight = fit.weight[:, part.lines]
    weight = weight / np.exp(np.mean(np.log(weight), axis=1, keepdims=True))
    refined = refine(lines.frequency, rest, fit.pole[members], data.quantity, weight)
    if np.any(np.abs(refined.pole - fit.pole[members]) > -strays * fit.pole[members].real):
        refined = linear_fit(lines.frequency, rest, fit.pole[members], data.quantity, weight)
    return refined.pole, refined.pole_covariance


def _functions(frf: FRF) -> Functions:
    """Lay the functions out as rows."""
    return Functions(
        frequency=frf.frequency,
        value=frf.value.reshape(-1, frf.frequency.size),
        run=np.repeat(frf.run, frf.input.node.size),
        quantity=frf.quantity,
        weight=_weight(frf),
    )


def _weight(frf: FRF) -> Reals:
    """Weights ``(n_function, n_frequency)`` of the lines; ones where no coherence was measured."""
    shape = (-1, frf.frequency.size)
    if frf.coherence is None:
        return np.broadcast_to(1.0, (frf.value.size // frf.frequency.size, frf.frequency.size))
    return coherence_weight(frf.value.reshape(shape), frf.coherence.reshape(shape))
