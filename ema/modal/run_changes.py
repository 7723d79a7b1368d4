"""Why roving runs differ: the mass of their sensors, a drift, all modes of a run alike, or scatter.

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
from numpy.typing import NDArray

from ema.modal.mass_cancellation import without_sensors
from ema.modal.roved import roved
from ema.types.modal_model import ModalModel, frequency_text

Cause = Literal["none", "sensor mass", "drift", "all modes alike", "scatter"]
_EXPLAINED = 0.5
"""Share of the squared shifts that a cause must explain."""
_TO_FIRST_ORDER = 0.25
"""The same of a mass to first order, below which it is not asked what it explains altogether, which takes long."""
_CHANCE = 0.01
"""Probability that scatter alone explains as much, below which a cause is named."""
_EACH = 3  # runs whose modes are told one by one


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
    shift: NDArray[np.float64]
    unknowns: int
    text: str


def run_changes(modal_model: ModalModel, run: NDArray[np.int64], *, sensors_rove: bool) -> RunChanges:
    """Say whether runs differ, and what makes them differ.

    Parameters
    ----------
    modal_model : ModalModel
    run : (n_dof,) int
        Run of each of its outputs.
    sensors_rove : bool
        Whether its outputs are where sensors sat; not so where a hammer roved and one sensor stayed.
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
    if sensors_rove and _falls_with_shape(modal_model, run, shift, weight) > _TO_FIRST_ORDER:
        patterns.append(_mass(modal_model, run, shift, weight))
    for pattern in patterns:
        left = float(np.sum(weight * (shift - pattern.shift) ** 2))
        spare = freedom - pattern.unknowns
        if spare < 1 or left > (1.0 - _EXPLAINED) * whole:
            continue
        ratio = (whole - left) / pattern.unknowns / max(left / spare, 1.0)
        likelihood = np.log(max(left, spare)) + pattern.unknowns * np.log(freedom) / freedom
        if scipy.special.fdtrc(pattern.unknowns, spare, ratio) < _CHANCE and likelihood < least:
            best, least = pattern, likelihood
    if best.cause == "sensor mass" and modal_model.sensor_mass > 0.0:
        best = replace(best, text=f"{1e3 * modal_model.sensor_mass:.2g} g each")
    return RunChanges(cause=best.cause, finding=f"{_size(modal_model, differs)}; {_cause(best)}")


def _over_runs(value: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weighted mean over runs of each mode, 0 of one that no run determines."""
    whole = weight.sum(axis=0)
    return np.asarray(np.sum(weight * value, axis=0) / np.where(whole > 0.0, whole, 1.0))


def _patterns(shift: NDArray[np.float64], weight: NDArray[np.float64]) -> list[_Pattern]:
    """Return what drifts and common shifts can explain of shifts of zero mean."""
    patterns = []
    order = np.broadcast_to(np.arange(len(shift), dtype=float)[:, None], shift.shape)
    line = order - _over_runs(order, weight)
    slope = float(np.sum(weight * line * shift) / np.sum(weight * line**2))
    change = 100.0 * slope * (len(shift) - 1)
    text = f"by {change:+.2g} % from the first to the last"
    patterns.append(_Pattern(cause="drift", shift=slope * line, unknowns=1, text=text))
    if shift.shape[1] > 1:
        own = np.sum(weight * shift, axis=1) / np.maximum(weight.sum(axis=1), 1e-300)
        alike = np.broadcast_to(own[:, None], shift.shape)
        alike = alike - _over_runs(alike, weight)
        patterns.append(_Pattern(cause="all modes alike", shift=alike, unknowns=len(shift) - 1, text=""))
    return patterns


def _falls_with_shape(
    modal_model: ModalModel,
    run: NDArray[np.int64],
    shift: NDArray[np.float64],
    weight: NDArray[np.float64],
) -> float:
    """Return the share of squared shifts that falls with the squared shapes at the sensors, a slope for each mode."""
    felt = np.array([np.sum(np.abs(modal_model.shape[run == k]) ** 2, axis=0) for k in modal_model.run])
    around = felt - _over_runs(felt, weight)
    stiffness = np.sum(weight * around**2, axis=0)
    slope = -np.sum(weight * around * shift, axis=0) / np.where(stiffness > 0.0, stiffness, np.inf)
    left = np.sum(weight * (shift + np.maximum(slope, 0.0) * around) ** 2)
    return float(1.0 - left / np.sum(weight * shift**2))


def _mass(
    modal_model: ModalModel,
    run: NDArray[np.int64],
    shift: NDArray[np.float64],
    weight: NDArray[np.float64],
) -> _Pattern:
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
    told = {
        "sensor mass": "the mass of the sensors does this, for shifts follow the square of the shape where they sit",
        "drift": "all modes drift with the order of the runs, as temperature or ageing moves them",
        "all modes alike": "all modes of a run move alike, as temperature or settling moves them",
        "scatter": "scatter between runs, which neither a sensor's mass nor a drift explains",
    }[pattern.cause]
    return f"{told}: {pattern.text}" if pattern.text else told


def _size(modal_model: ModalModel, differs: NDArray[np.bool_]) -> str:
    """Say which runs are off the median of the others, and by how much."""
    odd = np.flatnonzero(differs.any(axis=1))
    shift = np.array([_shift(modal_model, int(k)) for k in odd])
    numbers = [int(modal_model.run[k]) + 1 for k in odd]
    if odd.size <= _EACH:
        modes = [
            ", ".join(
                f"{frequency_text(modal_model.frequency[r], 1)} Hz by {100 * own[r]:+.3f} %"
                for r in np.flatnonzero(which)
            )
            for own, which in zip(shift, differs[odd], strict=True)
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


def _shift(modal_model: ModalModel, run: int) -> NDArray[np.float64]:
    """Return by which shares of their frequencies a run's modes are off those of the others, (n_mode,)."""
    others = np.delete(modal_model.run_frequency, run, axis=0)
    return np.asarray(modal_model.run_frequency[run] / np.median(others, axis=0) - 1.0)
