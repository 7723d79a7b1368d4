"""The choice of poles: from candidates to a fit of all modes of a band, and to the peaks that none explains.

Candidates that are no modes where all are fitted at once are taken away (`_screened`). What is left is refined, and
judged again, until every pole is a mode (`_refined`); poles that stand for one mode in different runs go
(`_without_images`). Then modes are sought in what the fit leaves, one at a time (`_with_further_modes`), and in peaks
(`take_in_peaks`). In the end modes of runs that seem to differ are asked for one more mode beside them
(`_run_by_run_borne_out`). What is asked of a pole or of a peak stands in `evidence`, and of single runs in `run_poles`.

A peak is judged in its own surroundings. What is left of the functions there is fitted once with the modes that are
near and once with one more; the likelihood of these lines alone decides, so that a misfit of a strong mode elsewhere in
the band, or noise of another size, does not hide a mode that anyone sees in the function. Peaks that are near each
other hide each other, since what one leaves counts as noise of the next: such a peak is tried beside poles for the
others, too, which are then judged in their turn.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from ema.identification.evidence import (
    EXPLAINS_LESS,
    LEAST_ALONE,
    LEAST_SHARE,
    LISTED,
    MANY_FUNCTIONS,
    Left,
    Peak,
    Refusal,
    Surroundings,
    holds_pole,
    is_confined,
    is_sound,
    is_split,
    judge,
    least_listed,
    left_of_functions,
    likeliest_poles,
    objections,
    share_left,
    significance_threshold,
    unexplained_peaks,
)
from ema.identification.functions import MAX_DAMPING, Functions, inside, resonant, response
from ema.identification.maximum_likelihood import NO_POLE, Fit, linear_fit, refine
from ema.identification.run_poles import RUNS_DIFFER, RunPoles, image_of_a_mode, moves_from_run_to_run, run_poles
from lamella_shared import Booleans, Complexes

_LOG = logging.getLogger(__name__)


def select_modes(data: Functions, candidates: Complexes, band: tuple[float, float]) -> tuple[Fit, RunPoles, Left]:
    """Refine what looks like a mode, then look for modes in what is left until none is found.

    Parameters
    ----------
    data : Functions
    candidates : (n_candidate,) complex
        Poles that may be modes, rad/s.
    band : (float, float)
        Where modes are wanted, Hz. A pole just outside of it is kept where it is needed for the misfit that
        the lower and upper residual terms leave at the ends of the band.

    Returns
    -------
    fit : Fit
        All modes together, ascending in frequency; those outside the band last.
    runs : RunPoles
        The same poles run by run.
    left : tuple of (Peak, str)
        Peaks that stay unexplained, each with the reason why it was not taken in.
    """
    first = _without_images(data, _refined(data, _screened(data, candidates), band), band, NO_POLE).pole
    # Fits are large: none is held beside those that are made after it.
    further = _with_further_modes(data, data.linear_fit(first), candidates, band).pole
    fit = _without_images(data, _refined(data, further, band), band, first)
    fit, left = take_in_peaks(data, fit, candidates, band)
    return *_run_by_run_borne_out(data, fit, candidates, band), left


def fit_chosen(data: Functions, pole: Complexes, band: tuple[float, float]) -> tuple[Fit, RunPoles, Left]:
    """Refine poles that were chosen by hand, and judge, add and take away none.

    The parameters and results are those of `select_modes`.
    """
    fit, runs = _finished(data, refine(data.frequency, data.value, pole, data.quantity), band)
    chosen = "the poles were chosen by hand"
    return fit, runs, tuple((peak, chosen) for peak in unexplained_peaks(data, fit))


def _screened(data: Functions, candidates: Complexes) -> Complexes:
    """Candidates left when the least likely one is taken away until all are modes at fixed poles."""
    pole = candidates
    while pole.size:
        verdicts = judge(data.frequency, data.linear_fit(pole), data.quantity)
        if verdicts.accepted.all():
            break
        score = np.where(verdicts.accepted, np.inf, verdicts.score)
        pole = np.delete(pole, np.argmin(score))
    return pole


def _refined(data: Functions, pole: Complexes, band: tuple[float, float]) -> Fit:
    """Refine, take away what is no mode, and refine again until every pole is one."""
    while True:
        fit = refine(data.frequency, data.value, pole, data.quantity)
        keep = _keep(data, fit, pole, band)
        if keep.all():
            return fit
        pole = pole[keep]


def _keep(data: Functions, fit: Fit, start: Complexes, band: tuple[float, float]) -> Booleans:
    """Which refined poles are modes of the band, or flanks of modes outside of it that are needed."""
    verdicts = judge(data.frequency, fit, data.quantity)
    modes = verdicts.accepted & is_sound(fit, start, band) & ~is_confined(fit, data.run)
    neighbours = (
        ~inside(fit.pole, band)
        & ~inside(start, band)
        & inside(fit.pole, (band[0] - (band[1] - band[0]), 2.0 * band[1] - band[0]))
        & (-fit.pole.real > 1e-6 * np.abs(fit.pole))
        & (-fit.pole.real < MAX_DAMPING * np.abs(fit.pole))
        & (verdicts.statistic > verdicts.threshold)
    )
    return modes | neighbours


def _without_images(data: Functions, fit: Fit, band: tuple[float, float], tried: Complexes) -> Fit:
    """Take away poles that stand for one mode at different places in different roving runs, none of those `tried`."""
    while (image := image_of_a_mode(data, fit, tried)) is not None:
        fit = _refined(data, np.delete(fit.pole, image), band)
    return fit


def _with_further_modes(data: Functions, fit: Fit, candidates: Complexes, band: tuple[float, float]) -> Fit:
    """Add the likeliest mode in what a fit leaves, and again, until no proposal is one.

    The others are judged when the search is over: a mode still missing spoils their phases.
    """
    threshold = significance_threshold(*data.value.shape)
    searching, start = True, None
    while searching:
        _LOG.debug("look for further modes beside %d poles", fit.pole.size)
        searching = False
        proposals, start = _proposals(data, fit, candidates, band, start)
        for proposal in proposals:
            trial = np.append(fit.pole, proposal)
            if not judge(data.frequency, data.linear_fit(trial), data.quantity).accepted[-1]:
                continue
            extended = refine(data.frequency, data.value, trial, data.quantity)
            gain = 2.0 * (fit.objective - extended.objective)
            if gain > threshold and _keep(data, extended, trial, band)[-1] and not is_split(extended, -1):
                fit = extended
                searching = True
                break
    return fit


def _proposals(
    data: Functions, fit: Fit, candidates: Complexes, band: tuple[float, float], start: Complexes | None
) -> tuple[Complexes, Complexes | None]:
    """Poles worth a trial: what stands out of the residuals, candidates that no pole of the fit is near, and flanks.

    Returned are these, and the poles of each run for the next time: a run need not find again what it has found.
    """
    flanks = _flanks(fit, band)
    if likeliest_poles(data.frequency, fit).size == 0:
        return flanks, start
    distance = np.abs(candidates[:, None] - fit.pole)
    unused = candidates[np.all(distance > -candidates.real[:, None], axis=1)]
    apart, start = _run_by_run(data, fit, start)
    return np.concatenate([likeliest_poles(data.frequency, apart), unused, flanks]), start


def _flanks(fit: Fit, band: tuple[float, float], *, aside: float = 0.03) -> Complexes:
    """Poles just beyond both ends of the band, by a share of it: the flank of a mode there stands out at no line.

    Left out, it is shared between the modes of the band: one 7 % above it, 1 % of every shape. Refinement moves it.
    """
    if fit.pole.size == 0:
        return NO_POLE
    damping = float(np.median(-fit.pole.real / np.abs(fit.pole)))
    off = aside * (band[1] - band[0])
    ends = 2.0 * np.pi * np.array([end for end in (band[0] - off, band[1] + off) if end > 0.0])
    return np.asarray(ends * (1j * np.sqrt(1.0 - damping**2) - damping))


def _run_by_run(data: Functions, fit: Fit, start: Complexes | None) -> tuple[Fit, Complexes | None]:
    """Leave the residuals of each run at its own poles where runs disagree: a shifted mode is no second one.

    Returned is with it where the poles of the runs are sought next time. They begin where they were, `start`, and new
    ones at those of the fit.
    """
    if start is not None:
        n = np.unique(data.run).size
        start = np.hstack([start, np.tile(fit.pole[start.shape[1] :], (n, 1))])
        start = np.where(np.abs(start - fit.pole) < -fit.pole.real, start, fit.pole)
    runs = run_poles(data, fit, start)
    known = np.where(np.isfinite(runs.frequency_std), runs.pole, fit.pole)
    if not runs.disagree():
        return fit, known
    residual, noise = np.empty_like(fit.residual), np.empty_like(fit.noise)
    for number, pole in zip(runs.run, runs.pole, strict=True):
        of_run = data.run == number
        alone = linear_fit(data.frequency, data.value[of_run], pole, data.quantity)
        residual[of_run], noise[of_run] = alone.residual, alone.noise
    return replace(fit, residual=residual, noise=noise), known


def take_in_peaks(
    data: Functions, fit: Fit, candidates: Complexes, band: tuple[float, float], *, most_tries: int = 3
) -> tuple[Fit, Left]:
    """Try what the functions show as a peak and the modes do not explain, until all of it is tried.

    Parameters
    ----------
    data : Functions
    fit : Fit
        The modes so far.
    candidates : (n_candidate,) complex
        Stable poles, rad/s, that may have been dropped.
    band : (float, float)
        Where modes are wanted, Hz.
    most_tries : int
        How often a peak is tried: its mode may be lost again when others are taken in.

    Returns
    -------
    fit : Fit
        All modes together.
    left : tuple of (Peak, str)
        Peaks that stay unexplained, each with the reason why it was not taken in.
    """
    refused: dict[int, Refusal] = {}
    tries: dict[int, int] = {}
    while True:
        taken: list[Peak] = []
        for peak in _possible_modes(data, fit):
            # A peak brings one mode, and again only if that was lost: what another would take of it is misfit.
            if peak.line in refused or tries.get(peak.line, 0) >= most_tries or holds_pole(data, fit, peak):
                continue
            tries[peak.line] = tries.get(peak.line, 0) + 1
            _LOG.debug("try the peak at %.5g Hz", peak.frequency)
            start = _starting_poles(data, peak, candidates)
            answer = try_peak(data, fit, peak, start, band)
            if isinstance(answer, Refusal):
                others = np.append(_poles_beside(data, fit, peak, candidates), _flanks_beside(data, fit, peak))
                again = try_peak(data, fit, peak, start, band, others) if others.size else answer
                answer = answer if isinstance(again, Refusal) else again
            if isinstance(answer, Refusal):
                refused[peak.line] = answer
            else:
                fit = data.linear_fit(answer, fit.weight)
                taken.append(peak)
        if not taken:
            return fit, peaks_to_report(data, fit, refused)
        # What hid a peak may be among what is taken in beside it.
        refused = {
            line: refusal
            for line, refusal in refused.items()
            if not any(abs(line - peak.line) <= _reach(peak) for peak in taken)
        }
        fit, useless = _without_useless(data, settled(data, fit), taken)
        refused |= dict.fromkeys(useless, Refusal(EXPLAINS_LESS))


def _possible_modes(data: Functions, fit: Fit) -> list[Peak]:
    """Unexplained peaks that may be modes: of few functions nothing but what is seen tells one from a misfit."""
    many = data.value.shape[0] >= MANY_FUNCTIONS
    return [peak for peak in unexplained_peaks(data, fit) if peak.visible or many]


def _reach(peak: Peak, *, half_widths: float = 8.0, fewest: int = 16) -> int:
    """Lines on each side of a peak that are its surroundings, on which it is judged."""
    return int(max(np.ceil(half_widths * peak.half_width), fewest))


def _starting_poles(data: Functions, peak: Peak, candidates: Complexes) -> Complexes:
    """Poles from which a peak is tried: the stable ones near it first, then that of its half-power bandwidth."""
    spacing = 2.0 * np.pi * float(data.frequency[1] - data.frequency[0])
    half_bandwidth = spacing * peak.half_width
    centre = 2.0 * np.pi * peak.frequency
    near = np.abs(candidates.imag - centre) < 2.0 * half_bandwidth
    return np.append(candidates[near], complex(-half_bandwidth, centre))


def _poles_beside(data: Functions, fit: Fit, peak: Peak, candidates: Complexes) -> Complexes:
    """Poles for the other peaks without one that anyone sees around a peak, each its likeliest starting pole."""
    others = [
        _starting_poles(data, other, candidates)[0]
        for other in unexplained_peaks(data, fit)
        if other.visible
        and 0 < abs(other.line - peak.line) <= _reach(peak)
        and not peak.first <= other.line <= peak.last
        and not holds_pole(data, fit, other)
    ]
    return np.array(others, dtype=complex)


def _flanks_beside(data: Functions, fit: Fit, peak: Peak) -> Complexes:
    """Poles beyond the ends of the band that a peak is near: else its own pole goes to the flank of a mode there."""
    end = data.frequency[[0, -1]]
    near = _reach(peak) * (data.frequency[1] - data.frequency[0]) >= np.abs(end - peak.frequency)
    flanks = _flanks(fit, (float(end[0]), float(end[1])))
    below = flanks.imag < 2.0 * np.pi * end[0]
    return np.concatenate([flanks[below & near[0]], flanks[~below & near[1]]])


def try_peak(
    data: Functions, fit: Fit, peak: Peak, start: Complexes, band: tuple[float, float], beside: Complexes = NO_POLE
) -> Complexes | Refusal:
    """Judge a peak on the lines around it, from each of several starting poles.

    Parameters
    ----------
    data : Functions
    fit : Fit
        The modes so far.
    peak : Peak
    start : (n_start,) complex
        Poles to begin with, rad/s.
    band : (float, float)
        Where modes are wanted, Hz.
    beside : (n_beside,) complex
        Poles, rad/s, that other peaks nearby may have: fitted beside it, and neither judged nor returned.

    Returns
    -------
    (n_mode,) complex or Refusal
        Poles of the whole fit with the likeliest one of the peak last and those near it refined beside it, rad/s;
        or why it is not to be taken in.
    """
    around = _surroundings(data, fit, peak, beside)
    if share_left(data, around, around.without, peak) < LEAST_SHARE * min(peak.share, 1.0):
        # Such lines count for little beside resonances; but what anyone sees there is in no mode of the result.
        alone = "the modes explain it where the lines around it are fitted alone, but not beside all others"
        return Refusal(alone, least_listed(peak, LISTED))
    best: tuple[float, Complexes] | None = None
    refusal = Refusal("no pole of the fit comes to rest there")
    for pole in start:
        trial = np.append(around.without.pole, pole)
        extended = refine(around.target.frequency, around.target.value, trial, data.quantity)
        objection = next(objections(data, around, extended, peak, band), None)
        if objection is not None:
            refusal = objection
        elif best is None or extended.objective < best[0]:
            best = extended.objective, extended.pole
    if best is None:
        return refusal
    n_near = int(np.count_nonzero(around.near))
    return np.concatenate([fit.pole[~around.near], best[1][:n_near], best[1][-1:]])


def _surroundings(data: Functions, fit: Fit, peak: Peak, beside: Complexes) -> Surroundings:
    """Fit the lines around a peak with the modes that are near, and with poles of other peaks, but not of its own."""
    lines = slice(max(0, peak.line - _reach(peak)), min(data.frequency.size, peak.line + _reach(peak) + 1))
    frequency = data.frequency[lines]
    near = (fit.pole.imag > 2.0 * np.pi * frequency[0]) & (fit.pole.imag < 2.0 * np.pi * frequency[-1])
    target = replace(data, frequency=frequency)
    value = fit.residual[:, lines] + response(target, fit.pole[near], fit.residue[:, near])
    target = replace(target, value=value)
    without = refine(frequency, value, fit.pole[near], data.quantity)
    if holds_pole(data, without, peak) and not holds_pole(data, fit, peak):  # it was drawn into the peak
        without = linear_fit(frequency, value, fit.pole[near], data.quantity)
    if beside.size:
        pole = np.append(without.pole, beside)
        without = refine(frequency, value, pole, data.quantity)
        if holds_pole(data, without, peak):
            without = linear_fit(frequency, value, pole, data.quantity)
    return Surroundings(lines, target, near, without)


def settled(data: Functions, fit: Fit, *, wander: float = 0.5) -> Fit:
    """Refine all modes together, but hold those that would wander (half bandwidths) to the misfit of stronger ones."""
    refined = refine(data.frequency, data.value, fit.pole, data.quantity, fit.weight)
    wanders = np.abs(refined.pole - fit.pole) > -wander * fit.pole.real
    if not wanders.any():
        return refined
    held = fit.pole[wanders]
    return refine(data.frequency, data.value, fit.pole[~wanders], data.quantity, fit.weight, held=held)


def _without_useless(data: Functions, fit: Fit, taken: list[Peak]) -> tuple[Fit, list[int]]:
    """Give up modes that explained their peaks on the lines around them, but do not beside all others.

    The misfit of much stronger modes may be as large as such a peak, and its residue goes there. So it is first tried
    whether lines that weigh by that misfit leave the residue to its mode.
    """
    useless = _useless(data, fit, taken)
    if useless:
        weighted = settled(data, data.weigh_by_misfit(fit))
        still = _useless(data, weighted, taken)
        if len(still) < len(useless) and weighted.objective < fit.objective:
            fit, useless = weighted, still
    if not useless:
        return fit, []
    centre = 2.0 * np.pi * np.array([peak.frequency for peak in useless])
    lost = np.unique(np.abs(fit.pole.imag[:, None] - centre).argmin(axis=0))
    without = data.linear_fit(np.delete(fit.pole, lost), fit.weight)
    return settled(data, without), [peak.line for peak in useless]


def _useless(data: Functions, fit: Fit, taken: list[Peak], *, most_left: float = 0.5) -> list[Peak]:
    """Peaks of which a fit leaves the most."""
    shares = [left_of_functions(data, fit, peak.window) for peak in taken]
    # Some functions may show nothing but noise there.
    return [peak for peak, share in zip(taken, shares, strict=True) if np.median(share) > most_left]


def peaks_to_report(data: Functions, fit: Fit, refused: dict[int, Refusal]) -> Left:
    """Peaks that a user is to know of, with the reasons, from why each line was refused."""
    left: list[tuple[Peak, str]] = []
    for peak in _possible_modes(data, fit):
        refusal = refused.get(peak.line)
        if holds_pole(data, fit, peak):
            if peak.visible and peak.share > LISTED:
                left.append((peak, "a mode is there, but the resonance is not that of a linear mode"))
        elif peak.share > max(
            LEAST_ALONE if peak.visible else LISTED, LEAST_ALONE if refusal is None else refusal.least
        ):
            left.append((peak, EXPLAINS_LESS if refusal is None else refusal.reason))
    return tuple(left)


def _run_by_run_borne_out(
    data: Functions, fit: Fit, candidates: Complexes, band: tuple[float, float]
) -> tuple[Fit, RunPoles]:
    """Finish a fit, and take runs to differ in those modes alone that are borne out on the lines around them.

    A mode beside another one, whose pole it draws elsewhere in each run, is taken in.
    """
    fit, runs = _finished(data, fit, band)
    while True:
        doubtful = np.flatnonzero((runs.probability < RUNS_DIFFER).any(axis=0) & resonant(fit.pole, band))
        if doubtful.size:
            _LOG.info("ask whether %d modes move from run to run of %d", doubtful.size, runs.run.size)
        answers = {int(r): moves_from_run_to_run(data, fit, int(r), candidates) for r in doubtful}
        beside = [local for _, local in answers.values() if local is not None]
        extended = _with_a_mode_beside(data, fit, beside, band)
        if extended is None:
            break
        fit, runs = _finished(data, extended, band)
    moves = np.array([r not in answers or answers[r][0] for r in range(fit.pole.size)], dtype=bool)
    return fit, replace(runs, probability=np.where(moves, runs.probability, 1.0))


def _with_a_mode_beside(data: Functions, fit: Fit, beside: list[Fit], band: tuple[float, float]) -> Fit | None:
    """Return the fit with the likeliest mode, if there is any, of those that lines around others show, the last each.

    Whether it has the phases of a mode is seen on the lines around it: beside all others what else is missing counts.
    """
    threshold = significance_threshold(*data.value.shape)
    best = None
    for local in beside:
        verdicts = judge(data.frequency[: local.residual.shape[1]], local, data.quantity)
        if not inside(local.pole, band)[-1] or not verdicts.accepted[-1] or is_split(local, -1):
            continue
        trial = np.append(fit.pole, local.pole[-1])
        extended = refine(data.frequency, data.value, trial, data.quantity, fit.weight)
        stays = is_sound(extended, trial, band)[-1] and not is_confined(extended, data.run)[-1]
        gain = 2.0 * (fit.objective - extended.objective)
        kept = stays and gain > threshold and not is_split(extended, -1)
        if kept and extended.objective < (fit if best is None else best).objective:
            best = extended
    return best


def _finished(data: Functions, fit: Fit, band: tuple[float, float]) -> tuple[Fit, RunPoles]:
    """Refine once more with the weights of the coherences, sort, and refine run by run.

    A function is weighted only where that makes its residuals likelier: coherences are lost in files, rounded,
    or low for other reasons than noise. Lines may weigh by the misfit already.
    """
    likelier = np.array(
        [
            np.sum(by_coherence * np.abs(rest) ** 2) < np.sum(before * np.abs(rest) ** 2)
            for by_coherence, before, rest in zip(data.weight, fit.weight, fit.residual, strict=True)
        ]
    )
    if likelier.any():
        weight = np.where(likelier[:, None], data.weight, fit.weight)
        weighted = refine(data.frequency, data.value, fit.pole, data.quantity, weight)
        # What leaves its resonance was held there by lines that now count for little.
        if np.all(np.abs(weighted.pole - fit.pole) < -fit.pole.real):
            fit = weighted
    rank = np.lexsort((np.abs(fit.pole), ~resonant(fit.pole, band)))
    fit = linear_fit(data.frequency, data.value, fit.pole[rank], data.quantity, fit.weight)
    return fit, run_poles(data, fit)
