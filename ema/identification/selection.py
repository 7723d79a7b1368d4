"""Which poles are modes: from candidates to a fit of all modes of a band."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.identification.functions import MAX_DAMPING, Functions, inside, resonant
from ema.identification.maximum_likelihood import Fit, linear_fit, refine
from ema.identification.residual_search import Left, take_in_peaks
from ema.identification.run_evidence import RunEvidence, run_evidence
from ema.identification.run_poles import FALSE_ALARM, RunPoles, run_poles
from ema.identification.significance import (
    is_confined,
    is_split,
    judge,
    likeliest_poles,
    significance_threshold,
)
from ema.identification.unexplained import unexplained_peaks

_LOG = logging.getLogger(__name__)
MAX_MOVE = 5.0
"""Half bandwidths that refinement may move a pole; one that moves further was no estimate of that mode."""
CLOSE = 3.0
"""Poles of different runs nearer than this many sums of their half bandwidths may be one mode."""
NEEDED, MANY = 0.5, 10.0
"""Rise of the logarithm of the likelihood that a pole brings to runs with poles of their own, over what these bring by
themselves and over the number of its unknowns, from which it is no image of another one."""
_KNOWN = 0.1  # of the logarithm of the likelihood of a run, of which `MANY` times the unknowns are asked for
_ASIDE = 0.03  # of the band, from its ends: where a flank's pole is first sought; refinement moves it


def select_modes(
    data: Functions, candidates: NDArray[np.complex128], band: tuple[float, float]
) -> tuple[Fit, RunPoles, Left]:
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
    none = np.empty(0, dtype=complex)
    fit = _without_images(data, _refined(data, _screen(data, candidates), band), band, none)
    before = fit.pole
    threshold = significance_threshold(*data.value.shape)
    searching, start = True, None
    while searching:
        _LOG.debug("look for further modes beside %d poles", fit.pole.size)
        searching = False
        proposals, start = _proposals(data, fit, candidates, band, start)
        for more in proposals:
            trial = np.append(fit.pole, more)
            if not judge(data.frequency, data.linear_fit(trial), data.quantity).accepted[-1]:
                continue
            extended = refine(data.frequency, data.value, trial, data.quantity)
            gain = 2.0 * (fit.objective - extended.objective)
            # The others are judged when the search is over: a mode still missing spoils their phases.
            if gain > threshold and _keep(data, extended, trial, band)[-1] and not is_split(extended, -1):
                fit = extended
                searching = True
                break
    fit = _without_images(data, _refined(data, fit.pole, band), band, before)
    fit, left = take_in_peaks(data, fit, candidates, band)
    return *_run_by_run_borne_out(data, fit, candidates, band), left


def _run_by_run_borne_out(
    data: Functions, fit: Fit, candidates: NDArray[np.complex128], band: tuple[float, float]
) -> tuple[Fit, RunPoles]:
    """Finish a fit, and take runs to differ in those modes alone that are borne out on the lines around them.

    A mode beside another one, whose pole it draws elsewhere in each run, is taken in.
    """
    fit, runs = _finished(data, fit, band)
    while True:
        doubtful = np.flatnonzero((runs.probability < FALSE_ALARM).any(axis=0) & resonant(fit.pole, band))
        if doubtful.size:
            _LOG.info("ask whether %d modes move from run to run of %d", doubtful.size, runs.run.size)
        found = {int(r): run_evidence(data, fit, int(r), candidates) for r in doubtful}
        extended = _with_modes_beside(data, fit, found.values(), band)
        if extended is None:
            break
        fit, runs = _finished(data, extended, band)
    still = np.array([r not in found or found[r].moves for r in range(fit.pole.size)], dtype=bool)
    return fit, replace(runs, probability=np.where(still, runs.probability, 1.0))


def _with_modes_beside(
    data: Functions, fit: Fit, found: Iterable[RunEvidence], band: tuple[float, float]
) -> Fit | None:
    """Return the fit with the likeliest mode that was found beside others, if there is any.

    Whether it has the phases of a mode is seen on the lines around it: beside all others what else is missing counts.
    """
    threshold = significance_threshold(*data.value.shape)
    further = [one.beside for one in found if one.beside is not None and inside(one.beside.pole, band)[-1]]
    best = None
    for local in further:
        verdicts = judge(data.frequency[: local.residual.shape[1]], local, data.quantity)
        if not verdicts.accepted[-1] or is_split(local, -1):
            continue
        trial = np.append(fit.pole, local.pole[-1])
        extended = refine(data.frequency, data.value, trial, data.quantity, fit.weight)
        stays = sound(extended, trial, band)[-1] and not is_confined(extended, data.run)[-1]
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
            np.sum(own * np.abs(rest) ** 2) < np.sum(other * np.abs(rest) ** 2)
            for own, other, rest in zip(data.weight, fit.weight, fit.residual, strict=True)
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


def fit_chosen(
    data: Functions, pole: NDArray[np.complex128], band: tuple[float, float]
) -> tuple[Fit, RunPoles, Left]:
    """Refine poles that were chosen by hand, and judge, add and take away none.

    The parameters and results are those of `select_modes`.
    """
    fit, runs = _finished(data, refine(data.frequency, data.value, pole, data.quantity), band)
    chosen = "the poles were chosen by hand"
    return fit, runs, tuple((peak, chosen) for peak in unexplained_peaks(data, fit))


def _proposals(
    data: Functions,
    fit: Fit,
    candidates: NDArray[np.complex128],
    band: tuple[float, float],
    start: NDArray[np.complex128] | None,
) -> tuple[NDArray[np.complex128], NDArray[np.complex128] | None]:
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


def _flanks(fit: Fit, band: tuple[float, float]) -> NDArray[np.complex128]:
    """Poles just beyond both ends of the band: the flank of a mode there is no line that stands out within it.

    Left out, it is shared between the modes of the band: one 7 % above it, 1 % of every shape.
    """
    if fit.pole.size == 0:
        return np.empty(0, dtype=complex)
    damping = float(np.median(-fit.pole.real / np.abs(fit.pole)))
    aside = _ASIDE * (band[1] - band[0])
    ends = 2.0 * np.pi * np.array([end for end in (band[0] - aside, band[1] + aside) if end > 0.0])
    return np.asarray(ends * (1j * np.sqrt(1.0 - damping**2) - damping))


def _without_images(
    data: Functions, fit: Fit, band: tuple[float, float], tried: NDArray[np.complex128]
) -> Fit:
    """Take away poles that stand for one mode at different places in different roving runs.

    Of two close poles the weaker one goes if the runs, each with poles of its own, are likelier without it. Those that
    are both at poles `tried` before are no such pair.
    """
    while (image := _image(data, fit, tried)) is not None:
        fit = _refined(data, np.delete(fit.pole, image), band)
    return fit


def _image(data: Functions, fit: Fit, tried: NDArray[np.complex128]) -> int | None:
    """Return the index of the weakest pole that the runs are likelier without, if there is one."""
    numbers = np.unique(data.run)
    if numbers.size < 3:
        return None
    _LOG.debug("ask whether two of %d poles are one mode in %d runs", fit.pole.size, numbers.size)
    runs = [data.value[data.run == n] for n in numbers]
    close = np.abs(fit.pole[:, None] - fit.pole) < CLOSE * -(fit.pole.real[:, None] + fit.pole.real)
    np.fill_diagonal(close, False)
    distance = np.abs(fit.pole[:, None] - tried)
    row, column = scipy.optimize.linear_sum_assignment(distance)
    added = np.ones(fit.pole.size, dtype=bool)
    added[row] = distance[row, column] > -fit.pole.real[row]
    suspects = np.any(close & (added[:, None] | added), axis=1)

    each: list[Fit] = []
    for i in np.argsort(np.sum(np.abs(fit.residue / fit.noise[:, None]) ** 2, axis=0)):
        if not suspects[i]:
            continue
        each = each or [_roughly(data, own, fit.pole) for own in runs]
        rest = np.delete(fit.pole, i)
        # Poles far from the one that is missing are those of the run with it.
        far = np.delete(~close[i], i)
        starts = [np.where(far, np.delete(own.pole, i), rest) for own in each]
        alone = _alone_without(data, fit, runs, each, starts, int(i))
        if alone is None:
            continue
        # Two unknowns for each pole and run, against Akaike's criterion for the common poles.
        if alone + 2 * rest.size * (numbers.size - 1) >= fit.objective + 2:
            continue
        # Poles of its own let a run meet whatever else the fit lacks. A mode is one that runs with poles of their own
        # need, too; an image is one mode more than each of them has.
        needed = alone - sum(own.objective for own in each)
        unknowns = 2 * (numbers.size + data.value.shape[0])
        if needed < max(NEEDED * (fit.objective - alone), MANY * unknowns):
            return int(i)
    return None


def _alone_without(
    data: Functions,
    fit: Fit,
    runs: list[NDArray[np.complex128]],
    each: list[Fit],
    starts: list[NDArray[np.complex128]],
    mode: int,
) -> float | None:
    """Objective of all runs, each with poles of its own but one; None as soon as it can be no image any more.

    A pole less is never likelier. So the runs that are not fitted yet leave at least what they leave with it, and those
    that show it best, which come first, mostly end the question.
    """
    with_it = sum(own.objective for own in each)
    most = max(NEEDED * (fit.objective - with_it), MANY * 2 * (len(runs) + data.value.shape[0]))
    most = min(most, fit.objective + 2 - 2 * starts[0].size * (len(runs) - 1) - with_it)
    lost, alone = 0.0, 0.0
    for k in np.argsort([-np.sum(np.abs(own.residue[:, mode] / own.noise) ** 2) for own in each]):
        without = _roughly(data, runs[k], starts[k]).objective
        alone += without
        lost += max(without - each[k].objective, 0.0)
        if lost >= most:
            return None
    return alone


def _roughly(data: Functions, value: NDArray[np.complex128], pole: NDArray[np.complex128]) -> Fit:
    """Refine poles on the functions of a run until its likelihood is known as well as it is asked for."""
    return refine(data.frequency, value, pole, data.quantity, tolerance=_KNOWN)


def _run_by_run(
    data: Functions, fit: Fit, start: NDArray[np.complex128] | None
) -> tuple[Fit, NDArray[np.complex128] | None]:
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
        own = data.run == number
        alone = linear_fit(data.frequency, data.value[own], pole, data.quantity)
        residual[own], noise[own] = alone.residual, alone.noise
    return replace(fit, residual=residual, noise=noise), known


def _refined(data: Functions, pole: NDArray[np.complex128], band: tuple[float, float]) -> Fit:
    """Refine, take away what is no mode, and refine again until every pole is one."""
    while True:
        fit = refine(data.frequency, data.value, pole, data.quantity)
        keep = _keep(data, fit, pole, band)
        if keep.all():
            return fit
        pole = pole[keep]


def _keep(
    data: Functions, fit: Fit, start: NDArray[np.complex128], band: tuple[float, float]
) -> NDArray[np.bool_]:
    """Which refined poles are modes of the band, or flanks of modes outside of it that are needed."""
    verdicts = judge(data.frequency, fit, data.quantity)
    modes = verdicts.accepted & sound(fit, start, band) & ~is_confined(fit, data.run)
    neighbours = (
        ~inside(fit.pole, band)
        & ~inside(start, band)
        & inside(fit.pole, (band[0] - (band[1] - band[0]), 2.0 * band[1] - band[0]))
        & (-fit.pole.real > 1e-6 * np.abs(fit.pole))
        & (-fit.pole.real < MAX_DAMPING * np.abs(fit.pole))
        & (verdicts.statistic > verdicts.threshold)
    )
    return modes | neighbours


def _screen(data: Functions, candidates: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Candidates left when the least likely one is taken away until all are modes at fixed poles."""
    pole = candidates
    while pole.size:
        verdicts = judge(data.frequency, data.linear_fit(pole), data.quantity)
        if verdicts.accepted.all():
            break
        score = np.where(verdicts.accepted, np.inf, verdicts.score)
        pole = np.delete(pole, np.argmin(score))
    return pole


def sound(fit: Fit, start: NDArray[np.complex128], band: tuple[float, float]) -> NDArray[np.bool_]:
    """Tell which refined poles are determined by the data and stayed where they started."""
    half_bandwidth = -fit.pole.real
    std = np.sqrt(np.diag(fit.pole_covariance)[1::2])
    moved = np.abs(fit.pole - start) > MAX_MOVE * np.maximum(half_bandwidth, -start.real)
    determined = (std < half_bandwidth) & (half_bandwidth <= MAX_DAMPING * np.abs(fit.pole))
    return inside(fit.pole, band) & ~moved & determined
