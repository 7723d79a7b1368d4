"""Modes over amplitude of a configuration at several forces: computed once, written, and read back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.identification.amplitude import (
    AmplitudeDependence,
    Level,
    amplitude_dependence,
    at_resonance,
    identify_force_levels,
)
from ema.types.modal_model import ModalModel
from updating.results.identified import MEASUREMENT, Assignment, Identified, made_from
from updating.results.store import read_current, read_frf, read_result, write_result

AMPLITUDE = "amplitude.json"
"""File of modes over amplitude, in the folder of a configuration."""


@dataclass(frozen=True, eq=False, kw_only=True)
class OverAmplitude:
    """What a configuration shows at its force levels.

    Attributes
    ----------
    dependence : AmplitudeDependence
        Its modes over amplitude.
    level : tuple of ModalModel
        The modes of each level, in the order of `dependence.level`, with frequencies and damping ratios in resonance.
    lost : tuple of str
        Why levels are left out.
    """

    dependence: AmplitudeDependence
    level: tuple[ModalModel, ...]
    lost: tuple[str, ...]

    @property
    def rms_motion(self) -> tuple[NDArray[np.float64], ...]:
        """Root mean square of the displacement amplitudes of all responses of each mode of each level, m."""
        return self._of_each_level(self.dependence.rms_motion)

    @property
    def motion(self) -> tuple[NDArray[np.float64], ...]:
        """Displacement amplitude at `dependence.point` of each mode of each level, m."""
        return self._of_each_level(self.dependence.motion)

    def _of_each_level(self, table: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return a table of the dependence in the order of the modes of each level."""
        found = []
        for modes, number, values in zip(self.level, self.dependence.mode, table, strict=True):
            own = np.full(modes.frequency.size, np.nan)
            own[number[number >= 0]] = values[number >= 0]
            found.append(own)
        return tuple(found)

    @property
    def findings(self) -> tuple[str, ...]:
        """What a user should read."""
        return (*self.lost, *self.dependence.findings)


def over_amplitude(assigned: Assignment, found: Identified) -> OverAmplitude | None:
    """Follow a configuration's modes over its force levels; write amplitude.json, or read back what a run left.

    Parameters
    ----------
    assigned : Assignment
        The configuration.
    found : Identified
        It at the force of its own files.

    Returns
    -------
    OverAmplitude or None
        None where it has no further level, or does not state its own force.

    Raises
    ------
    EmaError
        The files of a level cannot be read.
    StoreError
        The result cannot be written.
    """
    configuration = assigned.configuration
    if not configuration.force_levels or configuration.force is None:
        return None
    inputs, options = made_from(assigned)
    inputs = (*inputs, found.folder / MEASUREMENT)
    path = found.folder / AMPLITUDE
    earlier = read_current(path, OverAmplitude, inputs=inputs, options=options)
    if earlier is not None:
        return earlier
    own = Level(
        force=configuration.force, frf=read_frf(found.folder / MEASUREMENT), modal_model=found.modal_model
    )
    others, lost = identify_force_levels(assigned.campaign, configuration.name)
    levels = sorted((own, *others), key=lambda level: level.force)
    result = OverAmplitude(
        dependence=amplitude_dependence(configuration.name, levels),
        level=tuple(at_resonance(level) for level in levels),
        lost=lost,
    )
    write_result(path, result, inputs=inputs, options=options)
    return result


def stored_amplitude(found: Identified) -> OverAmplitude | None:
    """Return what `over_amplitude` wrote of a configuration; None of one without force levels.

    Raises
    ------
    StoreError
        It is missing or damaged.
    """
    configuration = found.configuration
    if not configuration.force_levels or configuration.force is None:
        return None
    return read_result(found.folder / AMPLITUDE, OverAmplitude)
