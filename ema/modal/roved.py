"""Modes of a roving test as each run has them, real and in the unit of the shape at the force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.modal.mass_cancellation import RovedModes
from ema.types.geometry import Dofs, driving_points
from ema.types.modal_model import ModalModel, synthesize


def roved(modal_model: ModalModel, run: NDArray[np.int64]) -> tuple[RovedModes, NDArray[np.complex128]]:
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


def _constant(modal_model: ModalModel, shape: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return what modal constants are over the shape, (n_mode,), of the force that all modes answer most to together.

    It is the shape at that force over the modal mass, both in the unit of the shape.
    """
    constant = 2.0 * np.abs(modal_model.pole.imag) * np.abs(modal_model.residue)
    size = np.sqrt(np.sum(constant**2, axis=0) / np.sum(np.abs(shape) ** 2, axis=0))
    return np.asarray(size[int(np.argmax(np.sum(size**2, axis=1)))])


def _beyond_band(modal_model: ModalModel, force: int) -> NDArray[np.float64]:
    """Return what modes beyond the band add to the receptance to one of the forces, (n_output, n_mode), m/N."""
    without = replace(modal_model, residue=np.zeros_like(modal_model.residue))
    at = np.abs(modal_model.pole) / (2.0 * np.pi)
    return synthesize(without, at, "receptance")[:, force].real


def usable(run_std: NDArray[np.float64], std: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return standard deviations of runs; where no run alone determines a mode, each stands for the pole of all."""
    nowhere = ~np.isfinite(run_std).any(axis=0)
    return np.where(nowhere, std * np.sqrt(len(run_std)), run_std)
