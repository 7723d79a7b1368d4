"""Modes followed from run to run where roving sensors or a drift move them by more than their bandwidths.

A fit of all runs by one pole then has a pole for each run, or none. So every run is first identified by itself, its
poles are linked to those of the other runs one to one, by frequency, and each run's functions are moved to common
poles: what the run's own modes answer is replaced by what modes of the same modal constants at the mean poles answer.
All runs together are then functions of one structure, with the noise that was measured, and are selected and fitted as
such. A mode that a run alone does not show, as its sensors sit near nodes, starts there from the pole of another run
that explains its functions best: a sensor at a node does not move a mode.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ema.identification.evidence import Left
from ema.identification.functions import Functions, resonant, response
from ema.identification.maximum_likelihood import Fit, linear_fit
from ema.identification.run_poles import RUNS_DIFFER, RunPoles, run_poles
from ema.identification.selection import select_modes
from ema.identification.stabilization import stabilization
from ema.types.frf import FRF
from lamella_shared import Complexes, Integers, Reals

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False, kw_only=True)
class Followed:
    """Runs moved to common poles.

    Attributes
    ----------
    value : (n_function, n_frequency) complex
        The functions as all runs would have them at the common poles.
    fit : Fit
        Fit of them; its residual is that of each run at its own poles.
    runs : RunPoles
        The poles of each run.
    left : tuple of (Peak, str)
        Peaks that stay unexplained.
    """

    value: Complexes
    fit: Fit
    runs: RunPoles
    left: Left


def runs_apart(
    fit: Fit, runs: RunPoles, left: Left, band: tuple[float, float], *, apart: float = 1.0, slightly: float = 0.3
) -> bool:
    """Whether runs differ by so much of the bandwidths that a fit by common poles may have missed or doubled modes.

    Poles outside the band, Hz, stand for whatever is there, and wander with the noise of each run: they do not count.

    `apart`, `slightly`: half bandwidths by which runs must differ for their modes to be followed, and where peaks stay
    unexplained: less, and one pole serves all.
    """
    differs = (runs.probability < RUNS_DIFFER).any(axis=0) & resonant(fit.pole, band)
    known = np.isfinite(runs.frequency_std) & differs
    off = np.where(known, np.abs(runs.pole - fit.pole) / -fit.pole.real, 0.0)
    return bool(np.any(off > (slightly if left else apart)))


def follow_runs(frf: FRF, data: Functions, order: int, band: tuple[float, float], together: Fit) -> Followed | None:
    """Identify each run, link the poles, and fit all runs moved to common ones.

    Parameters
    ----------
    frf : FRF
        The functions, on the lines of the band.
    data : Functions
        The same as rows.
    order : int
        Highest model order.
    band : (float, float)
        Where modes are wanted, Hz.
    together : Fit
        Fit by common poles.

    Returns
    -------
    Followed or None
        None where that is not likelier than the fit by common poles, each pole of a run counted (Akaike).
    """
    numbers = np.unique(data.run)
    alone = []
    for k, number in enumerate(numbers, start=1):
        _LOG.info("run %d of %d by itself, for runs differ", k, numbers.size)
        alone.append(_alone(frf, data, int(number), order, band))
    track = linked(alone)
    if track.shape[1] == 0:
        return None
    # What lies beyond the band would be sought in its last modes, differently in each run.
    beyond = together.pole[~resonant(together.pole, band)]
    track = np.hstack([_filled(data, numbers, track), np.tile(beyond, (numbers.size, 1))])
    # Modes that no run shows alone are found in the first round and followed in the second.
    for time in ("once", "twice"):
        _LOG.info("all runs moved to common poles, %s", time)
        runs = run_poles(data, data.linear_fit(_centre(track)), track)
        value = _moved(data, runs, _mean(runs))
        moved = replace(frf, value=value.reshape(frf.value.shape))
        candidates = np.concatenate([_mean(runs), stabilization(moved, order=order).chosen])
        fit, _, left = select_modes(replace(data, value=value), candidates, band)
        track = _carried(fit, runs)
    runs = run_poles(data, fit, track)
    value = _moved(data, runs, _mean(runs))
    fit = linear_fit(data.frequency, value, _mean(runs), data.quantity, fit.weight)
    followed = Followed(value=value, fit=fit, runs=replace(runs, followed=True), left=left)
    return followed if _worth(data, followed, together) else None


def _worth(data: Functions, followed: Followed, together: Fit, *, worth: float = 0.5) -> bool:
    """Whether poles of each run explain more power, and are likelier, each counted (Akaike).

    `worth`: share of what common poles leave of the power that poles of each run may leave, to be worth their number.
    """
    power = np.sum(np.abs(data.value) ** 2, axis=1)
    mine, theirs = (np.mean(np.sum(np.abs(fit.residual) ** 2, axis=1) / power) for fit in (followed.fit, together))
    more = 2 * followed.fit.pole.size * (followed.runs.run.size - 1)
    unknowns = 2 * (followed.fit.pole.size - together.pole.size) * (1 + data.value.shape[0])
    likelier = followed.fit.objective + more + unknowns < together.objective
    return bool(mine < worth * theirs and likelier)


def _alone(frf: FRF, data: Functions, number: int, order: int, band: tuple[float, float]) -> Complexes:
    """Return the poles of the band that a run shows by itself."""
    of_run = frf.outputs(frf.run == number)
    fit, _, _ = select_modes(data.of_run(number), stabilization(of_run, order=order).chosen, band)
    return fit.pole[resonant(fit.pole, band)]


def linked(poles: list[Complexes], *, rounds: int = 4, fewest: int = 2) -> Complexes:
    """Link the poles of runs one to one.

    Tracks begin as the poles of the run that shows most. Each run's poles go to the nearest tracks, the sum of squared
    distances least, which keeps their order; those that find none begin tracks of their own. Then medians are taken
    and all are assigned again.

    Parameters
    ----------
    poles : list of (n_pole,) complex
        Poles of each run, rad/s.
    rounds : int
        How often medians are taken and poles assigned.
    fewest : int
        Runs that show a mode by themselves.

    Returns
    -------
    (n_run, n_mode) complex
        Poles of each mode, ascending, NaN where a run does not show it; modes that one run alone shows left out.
    """
    centre = np.log(np.abs(max(poles, key=len)))
    for _ in range(rounds):
        row: list[dict[int, complex]] = [{} for _ in centre]
        for k, of_run in enumerate(poles):
            for i, t in _pairs(np.log(np.abs(of_run)), centre):
                row[t][k] = complex(of_run[i])
            for i in set(range(of_run.size)) - {i for i, _ in _pairs(np.log(np.abs(of_run)), centre)}:
                row.append({k: complex(of_run[i])})
                centre = np.append(centre, np.log(abs(of_run[i])))
        shown = [of_run for of_run in row if of_run]
        centre = np.array([np.median(np.log(np.abs(list(of_run.values())))) for of_run in shown])
    kept = sorted(
        (of_run for of_run in shown if len(of_run) >= fewest),
        key=lambda of_run: float(np.median(np.abs(list(of_run.values())))),
    )
    track = np.full((len(poles), len(kept)), complex(np.nan, np.nan))
    for r, members in enumerate(kept):
        for k, pole in members.items():
            track[k, r] = pole
    return track


def _pairs(of_run: Reals, centre: Reals, *, reach: float = 0.06) -> list[tuple[int, int]]:
    """Assign logarithms of frequencies to those of tracks, none beyond reach.

    The reach is the largest share by which a mode of one run may be off the median of the others.
    """
    square = (of_run[:, None] - centre) ** 2
    cost = np.where(square < reach**2, square, 10.0 * reach**2)
    row, column = scipy.optimize.linear_sum_assignment(cost)
    return [(int(i), int(t)) for i, t in zip(row, column, strict=True) if square[i, t] < reach**2]


def _centre(track: Complexes) -> Complexes:
    return np.asarray(np.nanmedian(track.real, axis=0) + 1j * np.nanmedian(track.imag, axis=0))


def _filled(data: Functions, numbers: Integers, track: Complexes) -> Complexes:
    """Give a run that does not show a mode the pole of that other run which explains its functions best."""
    filled = track.copy()
    centre = _centre(track)
    for k, number in enumerate(numbers):
        of_run = data.of_run(number)
        missing = np.isnan(track[k])
        filled[k, missing] = centre[missing]
        for r in np.flatnonzero(missing):
            filled[k, r] = _likeliest(of_run, filled[k], int(r), _spread(track[~np.isnan(track[:, r]), r]))
    return filled


def _spread(pole: Complexes, *, most_tried: int = 12) -> Complexes:
    """Return some of many poles, from the lowest to the highest frequency: more runs are to cost no more than a run.

    `most_tried`: poles of other runs that a mode is tried at which a run does not show.
    """
    if pole.size <= most_tried:
        return pole
    rank = np.argsort(np.abs(pole))
    return pole[rank[np.linspace(0, pole.size - 1, most_tried).round().astype(int)]]


def _likeliest(
    run: Functions, pole: Complexes, mode: int, tried: Complexes, *, around: float = 5.0, around_lines: float = 16.0
) -> complex:
    """Return which of some poles of a mode explains the functions of a run best on the lines around all of them.

    `around`, `around_lines`: half bandwidths and lines around these on which they are compared.
    """
    spacing = 2.0 * np.pi * float(run.frequency[1] - run.frequency[0])
    reach = max(around * float(-tried.real.min()), around_lines * spacing)
    omega = 2.0 * np.pi * run.frequency
    lines = (omega > tried.imag.min() - reach) & (omega < tried.imag.max() + reach)
    near = (pole.imag > tried.imag.min() - reach) & (pole.imag < tried.imag.max() + reach)
    near[mode] = True
    target = run.value[:, lines]
    if not near.all():
        others = run.linear_fit(pole).residue[:, ~near]
        target = target - response(run, pole[~near], others)[:, lines]
    misfit = []
    for trial in tried:
        trials = pole.copy()
        trials[mode] = trial
        misfit.append(linear_fit(run.frequency[lines], target, trials[near], run.quantity).objective)
    return complex(tried[int(np.argmin(misfit))])


def _mean(runs: RunPoles) -> Complexes:
    """Return the means of the poles of all runs, each weighing as it is certain."""
    std = np.where(np.isfinite(runs.frequency_std).any(axis=0), runs.frequency_std, 1.0)
    return np.average(runs.pole, axis=0, weights=std**-2.0)


def _moved(data: Functions, runs: RunPoles, pole: Complexes) -> Complexes:
    """Move the functions of each run from its own poles to common ones, modal constants kept."""
    value = data.value.copy()
    for number, of_run in zip(runs.run, runs.pole, strict=True):
        which = data.run == number
        residue = runs.residue[which]
        there = response(data, of_run, residue)
        here = response(data, pole, residue * (of_run.imag / pole.imag))
        value[which] += here - there
    return value


def _carried(fit: Fit, runs: RunPoles) -> Complexes:
    """Return where each run has the poles of a fit: those that were followed as far off the fit as they were."""
    centre = _mean(runs)
    track = np.tile(fit.pole, (runs.run.size, 1))
    row, column = scipy.optimize.linear_sum_assignment(np.abs(fit.pole[:, None] - centre))
    for r, t in zip(row, column, strict=True):
        if abs(fit.pole[r] - centre[t]) < -(fit.pole[r].real + centre[t].real):
            track[:, r] += runs.pole[:, t] - centre[t]
    return track
