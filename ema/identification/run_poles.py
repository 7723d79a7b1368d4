"""Poles of single roving runs: whether a mode moves from run to run, and whether two poles are one that does.

A sensor that roves takes its mass along, and a structure may change between runs. Either moves the poles of a
run against those of the others. The poles of each run are refined on that run's functions alone, and every
frequency is compared with the mean of the other runs.

Poles that each run has for itself meet whatever the modes of all runs lack: a mode beside another one that was not
found, or what strong resonances elsewhere are off by. So where runs seem to disagree about a mode, the lines around it
are fitted by themselves: with poles that all runs share, with a pole of the mode for each run, and with one more pole
that all share. A mode moves where poles of each run are the likeliest.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ema.identification.evidence import inflation, is_confined, variance_inflation
from ema.identification.functions import Functions, response
from ema.identification.maximum_likelihood import Fit, linear_fit, refine
from ema.identification.uncertainty import enlargement, run_noise
from ema.modal.runs import run_scatter, std_with_scatter
from ema.types.modal_model import RESOLVED
from lamella_shared import Booleans, Complexes, Integers, Reals

_LOG = logging.getLogger(__name__)
RUNS_DIFFER = 0.05
"""Chance that runs of one and the same structure are said to differ."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RunPoles:
    """What each roving run alone says of the poles.

    Attributes
    ----------
    run : (n_run,) int
        Numbers of the runs.
    pole : (n_run, n_mode) complex
        Poles, rad/s; those of all runs together where a run does not determine a mode.
    residue : (n_function, n_mode) complex
        Residues of the receptance at the poles of each function's own run, m/(N s).
    variance : (n_function, n_mode) float
        Variance of each of them along its own phase, noise common to a run included.
    frequency_std, damping_std : (n_run, n_mode) float
        Standard deviations, noise common to a run included, infinite where a run does not determine a mode.
    enlargement : (n_mode,) float
        Factor by which noise that is not independent enlarges the variances of the poles of all runs together.
    probability : (n_run, n_mode) float
        Probability that noise alone would make any run's frequency of any mode differ this much from those of
        the other runs (Bonferroni's bound); 1 where there is nothing to compare.
    followed : bool
        Whether the residues of the fit are those of runs at their own poles (`ema.identification.run_tracking`).
    """

    run: Integers
    pole: Complexes
    residue: Complexes
    variance: Reals
    frequency_std: Reals
    damping_std: Reals
    enlargement: Reals
    probability: Reals
    followed: bool = False

    def disagree(self) -> bool:
        """Whether any run differs significantly from the others."""
        return bool(np.any(self.probability < RUNS_DIFFER))

    def beside(self, fit: Fit, n: int, *, overlap: float = 2.0) -> RunPoles:
        """Return the same beside further poles, the last `n` of a fit, which no run is asked about.

        Nor are runs compared in modes that overlap others, within sums of half bandwidths: the few functions of one run
        tell them from misfit no more.
        """
        runs, ones = self.run.size, np.ones(n)
        further = fit.pole[-n:]
        near = np.abs(fit.pole[:, None] - fit.pole) < -overlap * (fit.pole.real[:, None] + fit.pole.real)
        alone = near.sum(axis=1)[:-n] == 1
        return replace(
            self,
            pole=np.hstack([self.pole, np.tile(further, (runs, 1))]),
            residue=np.hstack([self.residue, fit.residue[:, -n:]]),
            variance=np.hstack([self.variance, _variance(fit, np.ones(fit.pole.size))[:, -n:]]),
            frequency_std=np.hstack([self.frequency_std, np.full((runs, n), np.inf)]),
            damping_std=np.hstack([self.damping_std, np.full((runs, n), np.inf)]),
            enlargement=np.append(self.enlargement, ones),
            probability=np.hstack([np.where(alone, self.probability, 1.0), np.tile(ones, (runs, 1))]),
        )

    def growth(self, frequency_std: Reals, damping_std: Reals) -> Reals:
        """Factor by which the scatter between runs enlarges Re and Im of the poles of all runs together.

        Returned in turn for each mode, ``(2 n_mode,)``.

        Parameters
        ----------
        frequency_std, damping_std : (n_mode,) float
            Standard deviations from noise.
        """
        frequency, damping = np.abs(self.pole) / (2.0 * np.pi), -self.pole.real / np.abs(self.pole)
        with_scatter = [
            std_with_scatter(std, run_std, run_scatter(value, run_std)) / std
            for std, run_std, value in (
                (frequency_std, self.frequency_std, frequency),
                (damping_std, self.damping_std, damping),
            )
        ]
        return np.stack(with_scatter[::-1], axis=1).reshape(-1)  # damping is in Re, frequency in Im


def frequency_damping_std(pole: Complexes, covariance: Reals) -> tuple[Reals, Reals]:
    """Carry the covariance of Re and Im of poles to ``abs(s) / 2 pi`` and ``-Re(s) / abs(s)``.

    Returns the standard deviations ``(n_mode,)`` of frequency (Hz) and damping ratio, by linearisation.
    """
    size = np.abs(pole)
    index = 2 * np.arange(pole.size)
    real, imaginary = covariance[index, index], covariance[index + 1, index + 1]
    cross = covariance[index, index + 1]

    def deviation(by_real: Reals, by_imaginary: Reals) -> Reals:
        variance = by_real**2 * real + 2.0 * by_real * by_imaginary * cross + by_imaginary**2 * imaginary
        return np.sqrt(np.maximum(variance, 0.0))

    return (
        deviation(pole.real / (2.0 * np.pi * size), pole.imag / (2.0 * np.pi * size)),
        deviation(-(pole.imag**2) / size**3, pole.real * pole.imag / size**3),
    )


def variance_along(residue: Complexes, covariance: Reals) -> Reals:
    """Return the variance ``(n_function, n_mode)`` of each residue along its own phase."""
    direction = np.exp(1j * np.angle(residue))
    index = 2 * np.arange(residue.shape[1])
    return (
        direction.real**2 * covariance[:, index, index]
        + 2.0 * direction.real * direction.imag * covariance[:, index, index + 1]
        + direction.imag**2 * covariance[:, index + 1, index + 1]
    )


def run_poles(data: Functions, fit: Fit, start: Complexes | None = None) -> RunPoles:
    """Refine the poles of a fit run by run and compare the runs.

    Parameters
    ----------
    data : Functions
        What was fitted.
    fit : Fit
        Fit of all functions together; its weights hold for the runs too.
    start : (n_run, n_mode) complex, optional
        Where each run's poles are sought, rad/s; at those of the fit where not given.
    """
    numbers, n_mode = np.unique(data.run), fit.pole.size
    if numbers.size == 1:
        enlarged = enlargement((run_noise(data, fit),))
        stds = np.sqrt(enlarged.together) * enlarged.student * _stds(fit)
        return RunPoles(
            run=numbers,
            pole=fit.pole[None],
            residue=fit.residue,
            variance=_variance(fit, enlarged.together * enlarged.student**2),
            frequency_std=stds[:1],
            damping_std=stds[1:],
            enlargement=enlarged.together * enlarged.student**2,
            probability=np.ones((1, n_mode)),
        )
    weighted = replace(data, weight=fit.weight)
    pole = np.empty((numbers.size, n_mode), dtype=complex)
    std = np.empty((2, numbers.size, n_mode))
    residue, alone = np.empty(fit.residue.shape, dtype=complex), []
    for k, number in enumerate(numbers):
        of_run = weighted.of_run(number)
        pole[k], std[0, k], std[1, k] = _refined_alone(of_run, fit.pole if start is None else start[k])
        alone.append(_linear_fit(of_run, pole[k]))
        residue[data.run == number] = alone[k].residue
    enlarged = enlargement(tuple(run_noise(data.of_run(n), of_run) for n, of_run in zip(numbers, alone, strict=True)))
    std *= np.sqrt(enlarged.each)
    variance = np.empty(residue.shape)
    for number, its, factor in zip(numbers, alone, enlarged.each * enlarged.student**2, strict=True):
        variance[data.run == number] = _variance(its, factor)
    return RunPoles(
        run=numbers,
        pole=pole,
        residue=residue,
        variance=variance,
        frequency_std=std[0] * enlarged.student,
        damping_std=std[1] * enlarged.student,
        enlargement=enlarged.together * enlarged.student**2,
        probability=_disagreement(np.abs(pole) / (2.0 * np.pi), _resolved(std[0], fit.pole), enlarged.freedom),
    )


def _variance(fit: Fit, factor: Reals) -> Reals:
    """Return the variance of residues along their own phase, each mode's larger by a factor ``(n_mode,)``."""
    return variance_along(fit.residue, fit.residue_covariance()) * factor


def _refined_alone(run: Functions, pole: Complexes) -> tuple[Complexes, Reals, Reals]:
    """Refine on the functions of one run the poles that it determines; standard deviations of the others are infinite.

    Returned are the poles and the standard deviations of frequencies, Hz, and damping ratios in independent noise.
    """
    at_all = _linear_fit(run, pole)
    visible = _visible(at_all)
    while True:
        # What a run hardly shows would wander through its noise; it is taken out as the pole of all runs gives it.
        rest = run.value - response(run, pole[~visible], at_all.residue[:, ~visible])
        fit = refine(run.frequency, rest, pole[visible], run.quantity, run.weight)
        stds, inflation = _stds(fit), variance_inflation(run.frequency, fit)
        determined = _determined(fit.pole, pole[visible], np.sqrt(inflation) * stds[0])
        if determined.all():
            break
        # A pole that did wander leaves the others to rounding: again without it.
        visible[np.flatnonzero(visible)[~determined]] = False
    refined = pole.copy()
    frequency_std, damping_std = np.full((2, pole.size), np.inf)
    refined[visible], frequency_std[visible], damping_std[visible] = fit.pole, *stds
    return refined, frequency_std, damping_std


def _linear_fit(run: Functions, pole: Complexes) -> Fit:
    """Fit residues and residual terms at fixed poles with the weights of a run."""
    return linear_fit(run.frequency, run.value, pole, run.quantity, run.weight)


def _stds(fit: Fit) -> Reals:
    """Return standard deviations of frequencies, Hz, and damping ratios, ``(2, n_mode)``, in independent noise."""
    return np.stack(frequency_damping_std(fit.pole, fit.pole_covariance))


def _determined(pole: Complexes, start: Complexes, frequency_std: Reals) -> Booleans:
    """Whether each refined pole is certain within its half bandwidth and stayed near where it started."""
    half_bandwidth = np.maximum(-pole.real, -start.real)
    certain = 2.0 * np.pi * frequency_std < 0.5 * half_bandwidth
    return certain & (np.abs(pole - start) < 0.05 * np.abs(pole))


def _visible(fit: Fit, *, false_alarm: float = 1e-6) -> Booleans:
    """Whether the residues of each mode at its fixed pole stand out of the noise of a few functions."""
    index = 2 * np.arange(fit.pole.size)
    # Per unit noise the two parts of a residue have nearly equal variance and no correlation.
    diagonal = np.diagonal(fit.linear_covariance, axis1=1, axis2=2)
    variance = 0.5 * (diagonal[:, index] + diagonal[:, index + 1]) * fit.noise[:, None] ** 2
    return np.sum(np.abs(fit.residue) ** 2 / variance, axis=0) > scipy.special.chdtri(
        2 * fit.residue.shape[0], false_alarm
    )


def _resolved(std: Reals, pole: Complexes) -> Reals:
    """Return the standard deviations with which frequencies of runs are compared, Hz."""
    return np.hypot(std, RESOLVED * -pole.real / (2.0 * np.pi))


def _disagreement(value: Reals, std: Reals, freedom: Reals) -> Reals:
    """Probability of each run's distance ``(n_run, n_mode)`` from the others, which may scatter among themselves.

    The others' centre is their weighted median, so that a second odd run does not hide the first.
    """
    n_run, n_mode = value.shape
    probability = np.ones((n_run, n_mode))
    for r in range(n_mode):
        for k in np.flatnonzero(np.isfinite(std[:, r])):
            others = np.flatnonzero(np.isfinite(std[:, r]) & (np.arange(n_run) != k))
            if others.size == 0:
                continue
            rank = others[np.argsort(value[others, r])]
            weight = np.cumsum(std[rank, r] ** -2.0)
            centre = value[rank[np.searchsorted(weight, 0.5 * weight[-1])], r]
            # A median is pi / 2 times as uncertain, in variance, as the mean of normal numbers.
            spread = std[k, r] ** 2 + (0.5 * np.pi if others.size > 2 else 1.0) / weight[-1]
            probability[k, r] = 2.0 * scipy.special.stdtr(freedom[r], -abs(value[k, r] - centre) / np.sqrt(spread))
    return np.minimum(1.0, probability * probability.size)


def moves_from_run_to_run(
    data: Functions,
    fit: Fit,
    mode: int,
    candidates: Complexes,
    *,
    reach: float = 5.0,
    fewest_lines: int = 16,
    aside: tuple[float, ...] = (-1.0, -0.5, 0.5, 1.0),
    apart: float = 0.35,
    tolerance: float = 0.01,
) -> tuple[bool, Fit | None]:
    """Judge whether a mode moves from run to run, or seems to for another one beside it.

    Parameters
    ----------
    data : Functions
    fit : Fit
        The modes, with poles that all runs share.
    mode : int
        Which of them.
    candidates : (n_candidate,) complex
        Stable poles, rad/s, that may be further modes.
    reach, fewest_lines : float and int
        Half bandwidths on each side of the mode on which it is judged, and fewest lines.
    aside : tuple of float
        Half bandwidths beside the mode at which a further one is sought.
    apart : float
        Half bandwidths beside any other at which it may be: two poles nearer to each other are what one that moves by
        as little in some runs looks like to first order.
    tolerance : float
        To which logarithms of the likelihood are known, of which some ten decide.

    Returns
    -------
    moves : bool
        Whether a pole for each run is likelier than one that all share, alone or with a further one.
    beside : Fit or None
        The lines around the mode with a further pole, the last one, where that is likelier than both.
    """
    pole = fit.pole[mode]
    spacing = 2.0 * np.pi * float(data.frequency[1] - data.frequency[0])
    around = max(-reach * pole.real, fewest_lines * spacing)
    lines = np.abs(2.0 * np.pi * data.frequency - np.abs(pole)) < around
    near = np.abs(fit.pole.imag - pole.imag) < around
    frequency = data.frequency[lines]
    value = (data.value - response(data, fit.pole[~near], fit.residue[:, ~near]))[:, lines]
    near[mode] = False
    shared = refine(frequency, value, np.append(pole, fit.pole[near]), data.quantity)
    numbers = np.unique(data.run)
    gain, noise = np.empty(numbers.size), np.empty(numbers.size)
    for k, number in enumerate(numbers):
        of_run = value[data.run == number]
        alone = linear_fit(frequency, of_run, shared.pole, data.quantity)
        moved = refine(frequency, of_run, shared.pole[:1], data.quantity, held=shared.pole[1:], tolerance=tolerance)
        gain[k], noise[k] = 2.0 * (alone.objective - moved.objective), inflation(moved.whitened())
    if not np.any(gain > noise.max() * scipy.special.chdtri(2, RUNS_DIFFER / numbers.size)):
        return False, None
    start = [pole - 1j * offset * pole.real for offset in aside]
    start += [c for c in candidates if 0.5 * -pole.real < np.abs(c - pole) < around]
    tried = [refine(frequency, value, np.append(shared.pole, s), data.quantity, tolerance=tolerance) for s in start]
    distinct = [t for t in tried if np.abs(t.pole[-1] - t.pole[:-1]).min() > -apart * pole.real]
    if not distinct:
        return True, None
    further = min(distinct, key=lambda one: one.objective)
    # Unknowns are counted as Akaike does.
    by_runs = float(gain.sum()) - 2 * 2 * (numbers.size - 1)
    by_further = 2.0 * (shared.objective - further.objective) - 2 * (2 + 2 * len(value))
    # A further pole that one run alone needs is where the mode is in that run, and no further mode of all runs.
    if by_further > by_runs and not is_confined(further, data.run)[-1]:
        return False, further
    return True, None


def image_of_a_mode(
    data: Functions, fit: Fit, tried: Complexes, *, close: float = 3.0, needed: float = 0.5, many: float = 10.0
) -> int | None:
    """Return the weakest pole that the runs, each with poles of its own, are likelier without, if there is one.

    Two close poles may stand for one mode at different places in different runs.

    Parameters
    ----------
    data : Functions
    fit : Fit
    tried : (n_tried,) complex
        Poles that were asked about before, rad/s: two that are both among them are no such pair.
    close : float
        Sums of half bandwidths within which poles of different runs may be one mode.
    needed, many : float
        Rise of the logarithm of the likelihood that a pole brings to runs with poles of their own, over what these
        bring by themselves and over the number of its unknowns, from which it is no image of another one.
    """
    numbers = np.unique(data.run)
    if numbers.size < 3:
        return None
    _LOG.debug("ask whether two of %d poles are one mode in %d runs", fit.pole.size, numbers.size)
    runs = [data.value[data.run == n] for n in numbers]
    near = np.abs(fit.pole[:, None] - fit.pole) < close * -(fit.pole.real[:, None] + fit.pole.real)
    np.fill_diagonal(near, False)
    distance = np.abs(fit.pole[:, None] - tried)
    row, column = scipy.optimize.linear_sum_assignment(distance)
    added = np.ones(fit.pole.size, dtype=bool)
    added[row] = distance[row, column] > -fit.pole.real[row]
    suspects = np.any(near & (added[:, None] | added), axis=1)

    each: list[Fit] = []
    for i in np.argsort(np.sum(np.abs(fit.residue / fit.noise[:, None]) ** 2, axis=0)):
        if not suspects[i]:
            continue
        each = each or [_roughly(data, value, fit.pole) for value in runs]
        rest = np.delete(fit.pole, i)
        # Poles far from the one that is missing are those of the run with it.
        far = np.delete(~near[i], i)
        starts = [np.where(far, np.delete(run.pole, i), rest) for run in each]
        with_it = sum(run.objective for run in each)
        unknowns = many * 2 * (numbers.size + data.value.shape[0])
        # Two unknowns for each pole and run, against Akaike's criterion for the common poles.
        common = fit.objective + 2 - 2 * rest.size * (numbers.size - 1)
        most = min(max(needed * (fit.objective - with_it), unknowns), common - with_it)
        alone = _alone_without(data, runs, each, starts, int(i), most)
        if alone is None or alone + 2 * rest.size * (numbers.size - 1) >= fit.objective + 2:
            continue
        # Poles of its own let a run meet whatever else the fit lacks. A mode is one that runs with poles of their own
        # need, too; an image is one mode more than each of them has.
        if alone - with_it < max(needed * (fit.objective - alone), unknowns):
            return int(i)
    return None


def _alone_without(
    data: Functions, runs: list[Complexes], each: list[Fit], starts: list[Complexes], mode: int, most: float
) -> float | None:
    """Objective of all runs, each with poles of its own but one; None as soon as more than `most` is lost by that.

    A pole less is never likelier. So the runs that are not fitted yet leave at least what they leave with it, and those
    that show it best, which come first, mostly end the question.
    """
    lost, alone = 0.0, 0.0
    for k in np.argsort([-np.sum(np.abs(run.residue[:, mode] / run.noise) ** 2) for run in each]):
        without = _roughly(data, runs[k], starts[k]).objective
        alone += without
        lost += max(without - each[k].objective, 0.0)
        if lost >= most:
            return None
    return alone


def _roughly(data: Functions, value: Complexes, pole: Complexes) -> Fit:
    """Refine poles on the functions of a run until its likelihood is known as well as it is asked for: far below 10."""
    return refine(data.frequency, value, pole, data.quantity, tolerance=0.1)
