"""Modes of roving runs: as each run has them, why runs differ, and their mean.

Runs are taken as a random sample of what the structure and its sensors do from run to run: the random-effects model of
repeated measurements of unequal precision.

Each cause is a pattern of shifts over runs and modes. A mass lowers each mode by the square of its shape where the
sensors of a run sit; a drift moves all modes alike with the order of the runs, and temperature or settling all modes
of a run alike. A cause is named only where its pattern explains most of what noise does not, and better than the others
(Schwarz, Ann. Stat. 6, 1978), their numbers of unknowns counted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy

from ema.modal.mass_cancellation import BareModes, RovedModes, without_sensors
from ema.types.frf import Dofs, driving_points
from ema.types.modal_model import ModalModel, frequency_text, synthesize
from lamella_shared import Booleans, Complexes, Integers, Reals


def run_scatter(value: Reals, std: Reals) -> Reals:
    """Return the standard deviation between runs of each mode, ``(n_mode,)``, beyond what their noise explains.

    The estimate of Paule and Mandel (J. Res. Natl. Bur. Stand. 87, 1982, 377-385): with it, the weighted sum of squares
    about the mean is what it should be. 0 where noise explains all, and where fewer than two runs tell of a mode.

    Parameters
    ----------
    value : (n_run, n_mode) float
        What each run says.
    std : (n_run, n_mode) float
        Its standard deviation from noise; infinite where a run says nothing.
    """
    return np.array([_between(v[np.isfinite(s)], s[np.isfinite(s)]) for v, s in zip(value.T, std.T, strict=True)])


def _between(value: Reals, std: Reals) -> float:
    def excess(scatter: float) -> float:
        weight = 1.0 / (std**2 + scatter**2)
        return float(np.sum(weight * (value - np.average(value, weights=weight)) ** 2)) - (value.size - 1)

    if value.size < 2 or excess(0.0) <= 0.0:
        return 0.0
    largest = float(np.ptp(value))
    return float(scipy.optimize.brentq(excess, 0.0, largest * np.sqrt(value.size), xtol=1e-6 * largest))


def std_with_scatter(std: Reals, run_std: Reals, scatter: Reals, *, two_sided: float = 0.975) -> Reals:
    """Return standard deviations ``(n_mode,)`` of means over runs with the scatter between runs in them.

    What the scatter adds is larger by Student's over the normal quantile of 95 %, squared, for few runs tell little of
    it (Hartung and Knapp, Stat. Med. 20, 2001, 3875-3889) and intervals are taken as normal.

    Parameters
    ----------
    std : (n_mode,) float
        Of the means, from noise.
    run_std : (n_run, n_mode) float
        Of each run, from noise; infinite where a run says nothing.
    scatter : (n_mode,) float
        Standard deviation between runs.
    two_sided : float
        Probability whose quantiles are compared: that of a two-sided interval of 95 %.
    """
    known = np.isfinite(run_std)
    weight = np.where(known, 1.0, 0.0)
    least = np.where(known, run_std, 1.0)
    within, both = (
        1.0 / np.maximum(np.sum(weight / (least**2 + s**2), axis=0), np.finfo(float).tiny) for s in (0.0, scatter)
    )
    freedom = np.maximum(known.sum(axis=0) - 1.0, 1.0)
    quantile = scipy.special.stdtrit(freedom, two_sided) / scipy.special.ndtri(two_sided)
    more = np.where(scatter > 0.0, both - within, 0.0)
    return np.sqrt(std**2 + quantile**2 * more)


def roved(modal_model: ModalModel, run: Integers) -> tuple[RovedModes, Complexes]:
    """Return the modes of each run, real ones, and the phases of their shapes, (n_mode,)."""
    phase = np.exp(0.5j * np.angle(np.sum(modal_model.shape**2, axis=0)))
    output = Dofs(node=modal_model.node, direction=modal_model.direction)
    pairs = driving_points(output, modal_model.input)
    drive, drive_run = _constant(modal_model, modal_model.shape / phase), None
    if pairs and modal_model.scaled.any():
        point, _, sign = pairs[0]
        at = sign * modal_model.shape[point]
        phase = np.where(modal_model.scaled & (np.real(at / phase) < 0.0), -phase, phase)
        drive = np.where(modal_model.scaled, np.real(at / phase), 0.0)
        drive_run = int(np.searchsorted(modal_model.run, run[point]))
    free = modal_model.run_pole + modal_model.decay_rate
    return (
        RovedModes(
            frequency=np.abs(free) / (2.0 * np.pi),
            std=usable(modal_model.run_frequency_std, modal_model.frequency_std),
            shape=np.real(modal_model.shape / phase),
            run=np.searchsorted(modal_model.run, run),
            drive=drive,
            drive_run=drive_run,
            rest=None if drive_run is None else _beyond_band(modal_model, pairs[0][1]),
            drive_output=None if drive_run is None else pairs[0][0],
            drive_std=None if drive_run is None else modal_model.shape_std[pairs[0][0]],
        ),
        phase,
    )


def _constant(modal_model: ModalModel, shape: Complexes) -> Reals:
    """Return what modal constants are over the shape, (n_mode,), of the force that all modes answer most to together.

    It is the shape at that force over the modal mass, both in the unit of the shape.
    """
    constant = 2.0 * np.abs(modal_model.pole.imag) * np.abs(modal_model.residue)
    size = np.sqrt(np.sum(constant**2, axis=0) / np.sum(np.abs(shape) ** 2, axis=0))
    return np.asarray(size[int(np.argmax(np.sum(size**2, axis=1)))])


def _beyond_band(modal_model: ModalModel, force: int) -> Reals:
    """Return what modes beyond the band add to the receptance to one of the forces, (n_output, n_mode), m/N."""
    without = replace(modal_model, residue=np.zeros_like(modal_model.residue))
    at = np.abs(modal_model.pole) / (2.0 * np.pi)
    return synthesize(without, at, "receptance")[:, force].real


def usable(run_std: Reals, std: Reals) -> Reals:
    """Return standard deviations of runs; where no run alone determines a mode, each stands for the pole of all."""
    nowhere = ~np.isfinite(run_std).any(axis=0)
    return np.where(nowhere, std * np.sqrt(len(run_std)), run_std)


Cause = Literal["none", "sensor mass", "drift", "all modes alike", "scatter"]


@dataclass(frozen=True, kw_only=True)
class RunChanges:
    """How the roving runs of a configuration differ.

    Attributes
    ----------
    cause : {"none", "sensor mass", "drift", "all modes alike", "scatter"}
        What makes them differ.
    finding : str
        The runs, the size and the cause in one line; empty where they agree.
    """

    cause: Cause
    finding: str


@dataclass(frozen=True, eq=False, kw_only=True)
class _Pattern:
    """Shifts that a cause explains, (n_run, n_mode), with its number of unknowns and what it adds to the finding."""

    cause: Cause
    shift: Reals
    unknowns: int
    text: str


def run_changes(
    modal_model: ModalModel,
    run: Integers,
    *,
    sensors_rove: bool,
    explained: float = 0.5,
    to_first_order: float = 0.25,
    chance: float = 0.01,
) -> RunChanges:
    """Say whether runs differ, and what makes them differ.

    Parameters
    ----------
    modal_model : ModalModel
    run : (n_dof,) int
        Run of each of its outputs.
    sensors_rove : bool
        Whether its outputs are where sensors sat; not so where a hammer roved and one sensor stayed.
    explained : float
        Share of the squared shifts that a cause must explain.
    to_first_order : float
        The same of a mass to first order, below which it is not asked what it explains altogether, which takes long.
    chance : float
        Probability that scatter alone explains as much, below which a cause is named.
    """
    differs = modal_model.disagreeing_runs()
    if not differs.any():
        return RunChanges(cause="none", finding="")
    std = modal_model.resolved_run_std / modal_model.frequency
    weight = np.where(np.isfinite(std), std, np.inf) ** -2.0
    shift = np.where(weight > 0.0, modal_model.run_frequency / modal_model.frequency - 1.0, 0.0)
    shift = shift - _over_runs(shift, weight)
    freedom = int(np.count_nonzero(weight)) - int(np.count_nonzero(weight.any(axis=0)))
    whole = float(np.sum(weight * shift**2))
    best, least = _Pattern(cause="scatter", shift=np.zeros_like(shift), unknowns=0, text=""), np.log(whole)
    patterns = [*_patterns(shift, weight)]
    if sensors_rove and _falls_with_shape(modal_model, run, shift, weight) > to_first_order:
        patterns.append(_mass(modal_model, run, shift, weight))
    for pattern in patterns:
        left = float(np.sum(weight * (shift - pattern.shift) ** 2))
        spare = freedom - pattern.unknowns
        if spare < 1 or left > (1.0 - explained) * whole:
            continue
        ratio = (whole - left) / pattern.unknowns / max(left / spare, 1.0)
        likelihood = np.log(max(left, spare)) + pattern.unknowns * np.log(freedom) / freedom
        if scipy.special.fdtrc(pattern.unknowns, spare, ratio) < chance and likelihood < least:
            best, least = pattern, likelihood
    if best.cause == "sensor mass" and modal_model.sensor_mass > 0.0:
        best = replace(best, text=f"{1e3 * modal_model.sensor_mass:.2g} g each")
    return RunChanges(cause=best.cause, finding=f"{_size(modal_model, differs)}; {_cause(best)}")


def _over_runs(value: Reals, weight: Reals) -> Reals:
    """Return the weighted mean over runs of each mode, 0 of one that no run determines."""
    whole = weight.sum(axis=0)
    return np.asarray(np.sum(weight * value, axis=0) / np.where(whole > 0.0, whole, 1.0))


def _patterns(shift: Reals, weight: Reals) -> list[_Pattern]:
    """Return what drifts and common shifts can explain of shifts of zero mean."""
    patterns = []
    order = np.broadcast_to(np.arange(len(shift), dtype=float)[:, None], shift.shape)
    line = order - _over_runs(order, weight)
    slope = float(np.sum(weight * line * shift) / np.sum(weight * line**2))
    change = 100.0 * slope * (len(shift) - 1)
    text = f"by {change:+.2g} % from the first to the last"
    patterns.append(_Pattern(cause="drift", shift=slope * line, unknowns=1, text=text))
    if shift.shape[1] > 1:
        mean = np.sum(weight * shift, axis=1) / np.maximum(weight.sum(axis=1), 1e-300)
        alike = np.broadcast_to(mean[:, None], shift.shape)
        alike = alike - _over_runs(alike, weight)
        patterns.append(_Pattern(cause="all modes alike", shift=alike, unknowns=len(shift) - 1, text=""))
    return patterns


def _falls_with_shape(modal_model: ModalModel, run: Integers, shift: Reals, weight: Reals) -> float:
    """Return the share of squared shifts that falls with the squared shapes at the sensors, a slope for each mode."""
    felt = np.array([np.sum(np.abs(modal_model.shape[run == k]) ** 2, axis=0) for k in modal_model.run])
    around = felt - _over_runs(felt, weight)
    stiffness = np.sum(weight * around**2, axis=0)
    slope = -np.sum(weight * around * shift, axis=0) / np.where(stiffness > 0.0, stiffness, np.inf)
    left = np.sum(weight * (shift + np.maximum(slope, 0.0) * around) ** 2)
    return float(1.0 - left / np.sum(weight * shift**2))


def _mass(modal_model: ModalModel, run: Integers, shift: Reals, weight: Reals) -> _Pattern:
    """Return the shifts by the mass of the sensors: one of all modes, or each over a modal mass that nobody knows."""
    scaled = bool(modal_model.scaled.all())
    modes = roved(modal_model, run)[0]
    n_mode = shift.shape[1]
    bare = without_sensors(modes, None if scaled else np.full(n_mode, np.nan))
    explained = np.where(weight > 0.0, shift - bare.off_as_measured, 0.0)
    explained = explained - _over_runs(explained, weight)
    text = f"{1e3 * bare.load[0]:.2g} g each" if scaled else ""
    return _Pattern(cause="sensor mass", shift=explained, unknowns=1 if scaled else n_mode, text=text)


def _cause(pattern: _Pattern) -> str:
    causes = {
        "sensor mass": "the mass of the sensors does this, for shifts follow the square of the shape where they sit",
        "drift": "all modes drift with the order of the runs, as temperature or ageing moves them",
        "all modes alike": "all modes of a run move alike, as temperature or settling moves them",
        "scatter": "scatter between runs, which neither a sensor's mass nor a drift explains",
    }[pattern.cause]
    return f"{causes}: {pattern.text}" if pattern.text else causes


def _size(modal_model: ModalModel, differs: Booleans) -> str:
    """Say which runs are off the median of the others, and by how much."""
    most_listed = 3  # runs whose modes are reported one by one
    odd = np.flatnonzero(differs.any(axis=1))
    shift = np.array([_shift(modal_model, int(k)) for k in odd])
    numbers = [int(modal_model.run[k]) + 1 for k in odd]
    if odd.size <= most_listed:
        modes = [
            ", ".join(
                f"{frequency_text(modal_model.frequency[r], 1)} Hz by {100 * of_run[r]:+.3f} %"
                for r in np.flatnonzero(which)
            )
            for of_run, which in zip(shift, differs[odd], strict=True)
        ]
        if odd.size == 1:
            return f"run {numbers[0]} disagrees with the others: {modes[0]}"
        each = "; ".join(f"run {n}: {m}" for n, m in zip(numbers, modes, strict=True))
        return f"runs {', '.join(map(str, numbers))} disagree with the others: {each}"
    size = np.where(differs[odd], np.abs(shift), 0.0)
    i, r = np.unravel_index(int(np.argmax(size)), size.shape)
    n_run = modal_model.run.size
    which = (
        f"all {n_run} runs differ from each other"
        if odd.size == n_run
        else f"{odd.size} of {n_run} runs disagree with the others"
    )
    return (
        f"{which}, in the median by "
        f"{100 * np.median(size[differs[odd]]):.2g} % and at most by {100 * size[i, r]:.2g} % "
        f"(run {numbers[i]} at {frequency_text(modal_model.frequency[r], 1)} Hz)"
    )


def _shift(modal_model: ModalModel, run: int) -> Reals:
    """Return by which shares of their frequencies a run's modes are off those of the others, (n_mode,)."""
    others = np.delete(modal_model.run_frequency, run, axis=0)
    return np.asarray(modal_model.run_frequency[run] / np.median(others, axis=0) - 1.0)


def over_runs(modal_model: ModalModel, run: Integers, sensor_mass: float, changes: RunChanges) -> ModalModel:
    """Return the modes of the structure that runs of different structures stand for.

    Where runs disagree, frequencies and damping ratios are their medians, which one odd run does not move and which a
    fit of all runs by one pole would enlarge, and their scatter is in the intervals. Where the sensors have a mass that
    is stated, or that the runs tell (`run_changes`), it is taken out of frequencies, damping ratios and shapes; damping
    keeps its constant (viscous). A mode that is not mass-normalised is corrected only if its shifts from run to run
    tell by how much. Poles and residues stay those of the functions.

    Parameters
    ----------
    modal_model : ModalModel
        As identified.
    run : (n_dof,) int
        Run of each of its outputs; each output is taken for a sensor of its own in its direction.
    sensor_mass : float
        Mass of each sensor, kg; 0 where it is not stated.
    changes : RunChanges
        How the runs differ.
    """
    by_mass = changes.cause == "sensor mass"
    common = by_mass and sensor_mass == 0.0 and modal_model.scaled.all()
    known = modal_model.scaled & (sensor_mass > 0.0)
    load = np.where(known, sensor_mass, np.nan if by_mass else 0.0)
    if not load.any():
        return modal_model if changes.cause == "none" else _medians(modal_model)
    modes, phase = roved(modal_model, run)
    bare = _certain(modes, None if common else load)
    mass = float(bare.load[0]) if common else sensor_mass
    damping, damping_std = _damping(modal_model, bare)
    shift = np.average(modes.frequency, axis=0, weights=modes.std**-2.0) / bare.frequency - 1.0
    changed = _changed(modal_model, (bare.frequency, damping), (bare.frequency_std, damping_std))
    return replace(
        changed,
        shape=modal_model.shape + (bare.shape - modes.shape) * phase,
        sensor_shift=tuple(np.where(bare.load > 0.0, shift, 0.0).tolist()) if bare.load.any() else (),
        sensor_mass=mass if bare.load.any() else 0.0,
    )


def _changed(modal_model: ModalModel, value: tuple[Reals, Reals], std: tuple[Reals, Reals]) -> ModalModel:
    """Return a model of other frequencies and damping ratios; the covariance of its poles grows as their stds do."""
    ratio = np.maximum(std[0] / modal_model.frequency_std, std[1] / modal_model.damping_std)
    growth = np.repeat(ratio, 2)
    return replace(
        modal_model,
        frequency=value[0],
        frequency_std=std[0],
        damping=value[1],
        damping_std=std[1],
        covariance=modal_model.covariance * np.outer(growth, growth),
    )


def _medians(modal_model: ModalModel) -> ModalModel:
    """Return a model of the medians over the runs, weighted."""
    free = modal_model.run_pole + modal_model.decay_rate
    both = (
        (np.abs(free) / (2.0 * np.pi), usable(modal_model.run_frequency_std, modal_model.frequency_std)),
        (-free.real / np.abs(free), usable(modal_model.run_damping_std, modal_model.damping_std)),
    )
    value, std = [], []
    for of_mode, noise in both:
        scatter = run_scatter(of_mode, noise)
        value.append(_weighted_median(of_mode, 1.0 / (noise**2 + scatter**2)))
        std.append(std_with_scatter(np.sum(noise**-2.0, axis=0) ** -0.5, noise, scatter) * np.sqrt(0.5 * np.pi))
    return _changed(modal_model, (value[0], value[1]), (std[0], std[1]))


def _weighted_median(value: Reals, weight: Reals) -> Reals:
    """Return the values ``(n_mode,)`` that half of the weight of the runs is below."""
    rank = np.argsort(value, axis=0)
    below = np.cumsum(np.take_along_axis(weight, rank, axis=0), axis=0)
    middle = np.argmax(below >= 0.5 * below[-1], axis=0)
    return np.take_along_axis(value, rank, axis=0)[middle, np.arange(value.shape[1])]


def _certain(modes: RovedModes, load: Reals | None, *, certain: float = 3.0) -> BareModes:
    """Take the mass out, the scatter that it does not explain in the weights, and not where its size is uncertain.

    `certain`: standard deviations from which a mass that the runs tell is taken out.
    """
    bare = without_sensors(modes, load)
    if load is not None:
        uncertain = np.isnan(load) & (bare.load < certain * bare.load_std)
        load = np.where(uncertain, 0.0, load)
    scatter = run_scatter(bare.off * modes.frequency, modes.std)
    return without_sensors(replace(modes, std=np.hypot(modes.std, scatter)), load)


def _damping(modal_model: ModalModel, bare: BareModes) -> tuple[Reals, Reals]:
    """Return damping ratios, the means over the runs, and their standard deviations."""
    free = modal_model.run_pole + modal_model.decay_rate
    lowered = bare.frequency / (np.abs(free) / (2.0 * np.pi))
    value = -free.real / np.abs(free) * np.where(bare.load > 0.0, lowered, 1.0)
    std = usable(modal_model.run_damping_std, modal_model.damping_std)
    scatter = run_scatter(value, std)
    weight = 1.0 / (std**2 + scatter**2)
    noise = np.sum(std**-2.0, axis=0) ** -0.5
    return np.average(value, axis=0, weights=weight), std_with_scatter(noise, std, scatter)
