"""One modal model from runs that differ: their mean, without the mass of the sensors where it is known or shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.modal.mass_cancellation import BareModes, RovedModes, without_sensors
from ema.modal.roved import roved, usable
from ema.modal.run_changes import RunChanges
from ema.modal.run_scatter import run_scatter, std_with_scatter
from ema.types.modal_model import ModalModel

_CERTAIN = 3.0
"""Standard deviations from which a mass that the runs tell is taken out."""


def over_runs(
    modal_model: ModalModel, run: NDArray[np.int64], sensor_mass: float, changes: RunChanges
) -> ModalModel:
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
    told = changes.cause == "sensor mass"
    common = told and sensor_mass == 0.0 and modal_model.scaled.all()
    known = modal_model.scaled & (sensor_mass > 0.0)
    load = np.where(known, sensor_mass, np.nan if told else 0.0)
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


def _changed(
    modal_model: ModalModel,
    value: tuple[NDArray[np.float64], NDArray[np.float64]],
    std: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> ModalModel:
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
    for own, noise in both:
        scatter = run_scatter(own, noise)
        value.append(_weighted_median(own, 1.0 / (noise**2 + scatter**2)))
        std.append(
            std_with_scatter(np.sum(noise**-2.0, axis=0) ** -0.5, noise, scatter) * np.sqrt(0.5 * np.pi)
        )
    return _changed(modal_model, (value[0], value[1]), (std[0], std[1]))


def _weighted_median(value: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values ``(n_mode,)`` that half of the weight of the runs is below."""
    rank = np.argsort(value, axis=0)
    below = np.cumsum(np.take_along_axis(weight, rank, axis=0), axis=0)
    middle = np.argmax(below >= 0.5 * below[-1], axis=0)
    return np.take_along_axis(value, rank, axis=0)[middle, np.arange(value.shape[1])]


def _certain(modes: RovedModes, load: NDArray[np.float64] | None) -> BareModes:
    """Take the mass out, the scatter that it does not explain in the weights, and not where its size is uncertain."""
    bare = without_sensors(modes, load)
    if load is not None:
        uncertain = np.isnan(load) & (bare.load < _CERTAIN * bare.load_std)
        load = np.where(uncertain, 0.0, load)
    scatter = run_scatter(bare.off * modes.frequency, modes.std)
    return without_sensors(replace(modes, std=np.hypot(modes.std, scatter)), load)


def _damping(modal_model: ModalModel, bare: BareModes) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return damping ratios, the means over the runs, and their standard deviations."""
    free = modal_model.run_pole + modal_model.decay_rate
    lowered = bare.frequency / (np.abs(free) / (2.0 * np.pi))
    value = -free.real / np.abs(free) * np.where(bare.load > 0.0, lowered, 1.0)
    std = usable(modal_model.run_damping_std, modal_model.damping_std)
    scatter = run_scatter(value, std)
    weight = 1.0 / (std**2 + scatter**2)
    noise = np.sum(std**-2.0, axis=0) ** -0.5
    return np.average(value, axis=0, weights=weight), std_with_scatter(noise, std, scatter)
