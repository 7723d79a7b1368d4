"""Frequency and damping of each mode over amplitude, from one state of a structure at several forces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.identification.resonance import Resonances, resonances
from ema.modal.comparison import compare
from ema.types.arrays import readonly
from ema.types.frf import FRF
from ema.types.geometry import Dofs, driving_points
from ema.types.modal_model import ModalModel

Vector = NDArray[np.float64]

_SHOWS = 3.0
"""Standard deviations by which a change from the lowest to the highest amplitude must exceed 0 to be told."""
_DRIFT = 2e-4
"""Share of a frequency by which tests of one linear structure on one day differ: less is no change with amplitude."""
_DAMPING_DRIFT = 0.03
"""The same of a damping ratio."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Level:
    """One force level of a state: what was measured and identified.

    Attributes
    ----------
    force : float
        Amplitude of the force at every line, N.
    frf : FRF
        The functions.
    modal_model : ModalModel
        What was identified from them.
    """

    force: float
    frf: FRF
    modal_model: ModalModel


@dataclass(frozen=True, eq=False, kw_only=True)
class AmplitudeDependence:
    """Modes of one state of a structure over their amplitude, one row a force level, one column a mode.

    Attributes
    ----------
    name : str
        The configuration.
    level : tuple of str
        Names of the levels, by ascending force.
    force : (n_level,) float
        Amplitude of the force, N.
    point : str
        Degree of freedom that `motion` is of: the driving point where all levels measured it, else the one that moves
        most.
    frequency, frequency_std : (n_level, n_mode) float
        Natural frequency at the amplitude of resonance and its standard deviation, Hz; NaN where a level lacks a mode.
    damping, damping_std : (n_level, n_mode) float
        Damping ratios likewise.
    motion : (n_level, n_mode) float
        Displacement amplitude of `point` in resonance, in this mode alone, m.
    rms_motion : (n_level, n_mode) float
        Root mean square of the displacement amplitudes of all responses of the level, m.
    mode : (n_level, n_mode) int
        Number of the mode among those of its level, from 0; -1 where it has none.
    mac : (n_level, n_mode) float
        MAC with the same mode at the next lower level that has it.
    """

    name: str
    level: tuple[str, ...]
    force: Vector
    point: str
    frequency: Vector
    frequency_std: Vector
    damping: Vector
    damping_std: Vector
    motion: Vector
    rms_motion: Vector
    mode: NDArray[np.int64]
    mac: Vector

    def __post_init__(self) -> None:
        n = len(self.level)
        object.__setattr__(self, "force", readonly("AmplitudeDependence", "force", self.force, (n,)))
        shape = (n, np.shape(self.frequency)[-1])
        tables = ("frequency", "frequency_std", "damping", "damping_std", "motion", "rms_motion", "mac")
        for name in tables:
            array = readonly("AmplitudeDependence", name, getattr(self, name), shape)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "mode", readonly("AmplitudeDependence", "mode", self.mode, shape, int))

    @property
    def softening(self) -> Vector:
        """Share by which each frequency changes from the smallest to the largest amplitude, (n_mode,); NaN of one."""
        return _between_ends(self.frequency)

    @property
    def findings(self) -> tuple[str, ...]:
        """What a user should read, a line for each mode that at least two levels have."""
        return tuple(self._findings())

    def _findings(self) -> Iterator[str]:
        for r, share in enumerate(self.softening):
            if np.isnan(share):
                continue
            seen = np.flatnonzero(np.isfinite(self.frequency[:, r]))
            low, high = seen[0], seen[-1]
            f, xi = self.frequency[:, r], self.damping[:, r]
            f_std = np.hypot(*(self.frequency_std[[low, high], r] / f[[low, high]]))
            xi_std = np.hypot(*(self.damping_std[[low, high], r] / xi[[low, high]]))
            grown = xi[high] / xi[low] - 1.0
            softer = share < -_SHOWS * np.hypot(f_std, _DRIFT)
            changed = abs(share) > _SHOWS * np.hypot(f_std, _DRIFT) or abs(grown) > _SHOWS * np.hypot(
                xi_std, _DAMPING_DRIFT
            )
            what = (
                "contact that slips does this"
                if softer and grown > 0.0
                else "not linear"
                if changed
                else "no change with amplitude shows"
            )
            yield (
                f"{f[low]:.5g} Hz: from {self.motion[low, r]:.2g} to {self.motion[high, r]:.2g} m at {self.point} the "
                f"frequency changes by {100 * share:+.2g} % and the damping ratio from {100 * xi[low]:.2g} to "
                f"{100 * xi[high]:.2g} %: {what}"
            )


def _between_ends(table: Vector) -> Vector:
    """Return last over first number of each column, less 1; NaN where a column has fewer than two."""
    change = np.full(table.shape[1], np.nan)
    for r, column in enumerate(table.T):
        known = column[np.isfinite(column)]
        if known.size > 1:
            change[r] = known[-1] / known[0] - 1.0
    return change


def amplitude_dependence(name: str, levels: Sequence[Level]) -> AmplitudeDependence:
    """Follow the modes of one state of a structure from force level to force level.

    A mode goes on as the one of the next level with the most similar shape (`ema.modal.comparison`), however far its
    frequency moves; over few shared responses frequencies must agree to 10 %.

    Parameters
    ----------
    name : str
        The configuration.
    levels : sequence of Level
        At least one, in any order.
    """
    ordered = sorted(levels, key=lambda level: level.force)
    found = [resonances(level.frf, level.modal_model) for level in ordered]
    tracked = compare([level.modal_model for level in ordered])
    mode = np.full(tracked.frequency.shape, -1)
    for k, level in enumerate(ordered):
        for r, f in enumerate(level.modal_model.frequency):
            mode[k, tracked.frequency[k] == f] = r
    place, point = _reference([level.modal_model for level in ordered])
    motion = [
        level.force * own.response[o, i] for level, own, (o, i) in zip(ordered, found, place, strict=True)
    ]
    rms = [
        level.force * np.sqrt(np.mean(own.response[:, i] ** 2, axis=0))
        for level, own, (_, i) in zip(ordered, found, place, strict=True)
    ]

    def table(values: Sequence[Vector]) -> Vector:
        return np.array(
            [np.where(own >= 0, value[own], np.nan) for own, value in zip(mode, values, strict=True)]
        )

    return AmplitudeDependence(
        name=name,
        level=tuple(level.modal_model.name for level in ordered),
        force=np.array([level.force for level in ordered]),
        point=point,
        frequency=table([own.frequency for own in found]),
        frequency_std=table([own.frequency_std for own in found]),
        damping=table([own.damping for own in found]),
        damping_std=table([own.damping_std for own in found]),
        motion=table(motion),
        rms_motion=table(rms),
        mode=mode,
        mac=tracked.mac,
    )


def at_resonance(level: Level) -> ModalModel:
    """Return the modes of a level with frequencies and damping ratios at the amplitude of resonance."""
    found: Resonances = resonances(level.frf, level.modal_model)
    return replace(
        level.modal_model,
        frequency=found.frequency,
        damping=found.damping,
        frequency_std=found.frequency_std,
        damping_std=found.damping_std,
    )


def _reference(models: Sequence[ModalModel]) -> tuple[list[tuple[int, int]], str]:
    """Return output and input of each level that motion is stated for, and the name of that degree of freedom."""
    names = [{_name(model, k): k for k in range(model.node.size)} for model in models]
    shared = [key for key in names[0] if all(key in other for other in names)]
    driven = {
        _name(models[0], o): i
        for o, i, _ in driving_points(_outputs(models[0]), models[0].input)
        if _name(models[0], o) in shared
    }
    size = np.abs(models[0].residue).sum(axis=(1, 2))
    point = next(iter(driven), max(shared or names[0], key=lambda key: size[names[0][key]]))
    return [(own.get(point, 0), driven.get(point, 0)) for own in names], point


def _outputs(model: ModalModel) -> Dofs:
    return Dofs(node=model.node, direction=model.direction)


def _name(model: ModalModel, k: int) -> str:
    return _outputs(model).name(k)
