"""The structure without the sensors that were on it: what roving masses do to modes, and how it is taken out.

A mass m at a point with the mass-normalised shapes ``phi`` changes ``Lambda q = omega**2 q`` to ``Lambda q = omega**2
(I + m phi.T phi) q``. This is the identity of Sherman and Morrison for the receptance of the loaded structure
(Çakar and Sanliturk, Mech. Syst. Signal Process. 19, 2005, 87-104), written in the modes of the band. Every run has a
structure of its own; the one without sensors is that whose runs, loaded, have the poles and modal constants that were
measured.
Where neither the mass nor the scale of a mode is known, the shifts from run to run tell their product: mass-change
scaling (Parloo, Verboven, Guillaume and Van Overmeire, Mech. Syst. Signal Process. 16, 2002, 757-767).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

_MAX_STEP = 200
_SHARE = 0.5
"""Of a step that is taken: near a node of a mode at the force, whole steps overshoot and come back for ever."""
_CONVERGED = 1e-12  # of the squared frequencies
_MOST_AT_FORCE = 2.0
"""Factor by which sensors may change the shape at the force: next to its nodes the modes of the band tell no more."""
_HEAVIEST = 0.5
"""Largest share of a modal mass that sensors of one run may add; beyond it the modes of the band do not suffice."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RovedModes:
    """Modes of a structure as each run of a roving test has them.

    Attributes
    ----------
    frequency : (n_run, n_mode) float
        Undamped natural frequencies of each run, Hz.
    std : (n_run, n_mode) float
        Their standard deviations, Hz; infinite where a run does not determine a mode.
    shape : (n_output, n_mode) float
        Modal constants of each output in its own run over the shape at the force in `drive_run`, 1/sqrt(kg); in any
        unit for modes without a scale.
    run : (n_output,) int
        Row of `frequency` that each output belongs to.
    drive : (n_mode,) float
        Shape at the force in the same unit as `shape`, as the run has it that measured the driving point; of no account
        where none did.
    drive_run : int or None
        That run.
    """

    frequency: NDArray[np.float64]
    std: NDArray[np.float64]
    shape: NDArray[np.float64]
    run: NDArray[np.int64]
    drive: NDArray[np.float64]
    drive_run: int | None


@dataclass(frozen=True, eq=False, kw_only=True)
class BareModes:
    """Modes of the structure without sensors.

    Attributes
    ----------
    frequency : (n_mode,) float
        Undamped natural frequencies, Hz.
    frequency_std : (n_mode,) float
        Standard deviations, Hz, with the scatter of the runs about what the mass explains, and with what the modes
        beyond the band may be worth.
    shape : (n_output, n_mode) float
        Shapes in the unit of those that were measured.
    load : (n_mode,) float
        Mass of one sensor in the unit of the shapes: in kg where they are mass-normalised.
    load_std : (n_mode,) float
        Its standard deviations; 0 where it was given.
    off : (n_run, n_mode) float
        By how much the frequencies of the loaded runs are off, as shares: measured less predicted.
    """

    frequency: NDArray[np.float64]
    frequency_std: NDArray[np.float64]
    shape: NDArray[np.float64]
    load: NDArray[np.float64]
    load_std: NDArray[np.float64]
    off: NDArray[np.float64]


def loaded(
    square: NDArray[np.float64], shape: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the modes of a structure with masses on it.

    Parameters
    ----------
    square : (n_mode,) float
        Squared angular frequencies without the masses.
    shape : (n_load, n_mode) float
        Mass-normalised shapes at the masses, times the square root of each mass.

    Returns
    -------
    square : (n_mode,) float
        Squared angular frequencies with the masses, in the order of the modes without.
    turn : (n_mode, n_mode) float
        Modes with the masses, in columns, as combinations of those without, mass-normalised and of like sign.
    """
    value, turn = scipy.linalg.eigh(np.diag(square), np.eye(square.size) + shape.T @ shape)
    _, own = linear_sum_assignment(-np.abs(turn))
    return value[own], turn[:, own] * np.sign(np.diag(turn[:, own]))


def without_sensors(modes: RovedModes, load: NDArray[np.float64] | None) -> BareModes:
    """Return the modes that the structure has without the sensors of any run.

    From a first guess, each run is loaded by its own sensors (`loaded`); what its poles and modal constants then differ
    from the measured ones by corrects the guess. That is a Gauss-Newton iteration, for a load is small.

    Parameters
    ----------
    modes : RovedModes
    load : (n_mode,) float or None
        Mass of one sensor in the unit of the shapes; NaN for a mode where the shifts from run to run are to tell it,
        None where they tell one mass for all modes.
    """
    free = np.isnan(load) if load is not None else np.zeros(modes.drive.size, dtype=bool)
    weight = np.where(np.isfinite(modes.std), modes.std, np.inf) ** -2.0
    measured = (2.0 * np.pi * modes.frequency) ** 2
    square = np.average(measured, axis=0, weights=weight)
    shape, drive = modes.shape.copy(), modes.drive.copy()
    own_load = np.zeros(square.size) if load is None else np.where(free, 0.0, load)
    for _ in range(_MAX_STEP):
        off, constant, at_force, felt = _differences(modes, measured, square, shape, drive, own_load)
        step = _steps(off / measured, felt, weight * modes.frequency**2, None if load is None else free)
        square = square * (1.0 + _SHARE * step[0])
        own_load = np.clip(own_load + _SHARE * step[1], 0.0, _HEAVIEST / np.maximum(felt.max(axis=0), 1e-300))
        shape = shape + _SHARE * constant
        drive = drive + _SHARE * at_force
        if np.max(np.abs(step[0])) < _CONVERGED:
            break
    frequency = np.sqrt(square) / (2.0 * np.pi)
    std, load_std = _stds(off / measured, felt, weight * modes.frequency**2, None if load is None else free)
    lost = np.abs(np.average(measured, axis=0, weights=weight) / square - 1.0)
    return BareModes(
        frequency=frequency,
        frequency_std=np.hypot(std, _beyond_band(square, np.where(own_load > 0.0, lost, 0.0))) * frequency,
        shape=shape,
        load=own_load,
        load_std=load_std,
        off=0.5 * off / measured,
    )


def _beyond_band(square: NDArray[np.float64], lost: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what the next modes beyond both ends of the band may move the frequencies by, as shares of them.

    To second order a mode s moves the squared frequency of a mode r by its share m**2 phi_r**2 phi_s**2 /
    (1 - lambda_s / lambda_r), see Fox and Kapoor, AIAA J. 6, 1968. It is taken to be as far beyond the band as the
    modes in it are apart, and to feel the sensors as they do in the mean.

    Parameters
    ----------
    square : (n_mode,) float
        Squared angular frequencies without the sensors.
    lost : (n_mode,) float
        Shares that the squared frequencies lose by the sensors, m phi**2.
    """
    own = np.sort(np.sqrt(square))
    apart = (own[-1] - own[0]) / (own.size - 1) if own.size > 1 else 0.5 * own[0]
    ends = np.array([end for end in (own[0] - apart, own[-1] + apart) if end > 0.0])
    near = np.abs(1.0 - ends[:, None] ** 2 / square)
    return np.asarray(0.5 * lost * lost.mean() * np.sum(1.0 / near, axis=0))


def _differences(
    modes: RovedModes,
    measured: NDArray[np.float64],
    square: NDArray[np.float64],
    shape: NDArray[np.float64],
    drive: NDArray[np.float64],
    load: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Measured less predicted squared frequencies, shapes and shape at the force, and the squared shapes under load."""
    off, felt = np.zeros((2, *measured.shape))
    constant, at_force = np.zeros_like(shape), np.zeros_like(drive)
    known = load > 0.0
    unit = np.sqrt(np.where(known, load, 1.0))
    if modes.drive_run is None:
        drive = np.where(
            known, 1.0 / unit**2, 0.0
        )  # times the mass: a load is the mass over the square at the force
    reference = drive if modes.drive_run is None else modes.drive
    for k in range(len(measured)):
        own = modes.run == k
        predicted, turn = loaded(square, shape[own] * np.sqrt(load))
        off[k] = measured[k] - predicted
        felt[k] = np.sum(shape[own] ** 2, axis=0)
        # load times squared shape counts, whatever the unit of a mode
        here, force = (shape[own] * unit) @ turn / unit, (drive * unit) @ turn / unit
        if modes.drive_run == k:
            at_force = modes.drive - force
        ratio = np.divide(force, reference, out=np.ones_like(force), where=known & (reference != 0.0))
        ratio = np.clip(ratio, 1.0 / _MOST_AT_FORCE, _MOST_AT_FORCE)
        constant[own] = modes.shape[own] - here * ratio
    return off, constant, at_force, felt


def _steps(
    off: NDArray[np.float64],
    felt: NDArray[np.float64],
    weight: NDArray[np.float64],
    free: NDArray[np.bool_] | None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Relative steps of the squared frequencies and steps of the loads that runs which are off ask for."""
    middle = np.average(off, axis=0, weights=weight)
    around = felt - np.average(felt, axis=0, weights=weight)
    pull = -np.sum(weight * around * (off - middle), axis=0)
    stiffness = np.sum(weight * around**2, axis=0)
    if free is None:
        load = np.full(middle.size, pull.sum() / stiffness.sum())
    else:
        load = np.where(free & (stiffness > 0.0), pull / np.where(stiffness > 0.0, stiffness, 1.0), 0.0)
    return middle + load * np.average(felt, axis=0, weights=weight), load


def _stds(
    off: NDArray[np.float64],
    felt: NDArray[np.float64],
    weight: NDArray[np.float64],
    free: NDArray[np.bool_] | None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Relative standard deviations of the frequencies, and those of the loads, from what is off in the end."""
    known = np.count_nonzero(weight, axis=0)
    unknown = 1.0 + (np.zeros(known.size) if free is None else free)
    scatter = np.sum(weight * (0.5 * off) ** 2, axis=0) / np.maximum(known - unknown, 1.0)
    variance = np.maximum(scatter, 1.0) / weight.sum(axis=0)
    mean = np.average(felt, axis=0, weights=weight)
    stiffness = 0.25 * np.sum(weight * (felt - mean) ** 2, axis=0) / np.maximum(scatter, 1.0)
    if free is None:
        load = np.full(known.size, stiffness.sum() ** -0.5)
    else:
        load = np.where(free, np.maximum(stiffness, 1e-300) ** -0.5, 0.0)
    return np.sqrt(variance + (0.5 * mean * load) ** 2), load
