"""Modes as a file of another program holds them, before they become a modal model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.types.arrays import readonly
from ema.types.errors import MeasurementError


@dataclass(frozen=True, kw_only=True)
class ModesStd:
    """Relative standard deviations of modes that another program identified; None where the campaign states none.

    Attributes
    ----------
    frequency, damping : float or None
        Over the frequency and the damping ratio.
    shape : float or None
        Of a component, over the root mean square of the shape's components.
    """

    frequency: float | None = None
    damping: float | None = None
    shape: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class FoundModes:
    """Modes of one file or several; what the file does not state is NaN.

    Attributes
    ----------
    source : str
        The file, for messages.
    frequency, damping : (n_mode,) float
        Undamped natural frequencies, Hz, and damping ratios.
    frequency_std, damping_std : (n_mode,) float
        Their standard deviations, Hz and 1.
    shape : (n_dof, n_mode) complex
        Shapes of displacement: 1/sqrt(kg) where `scaled`, else of any scale.
    shape_std : (n_mode,) float
        Standard deviation of a component, over the root mean square of the components.
    scaled : (n_mode,) bool
        Which shapes have unit modal mass.
    node : (n_dof,) int
        Point of each component.
    direction : (n_dof, 3) float
        Its direction in global coordinates.
    notes : tuple of str
        What was odd in the file and how it was resolved.
    """

    source: str
    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
    frequency_std: NDArray[np.float64]
    damping_std: NDArray[np.float64]
    shape: NDArray[np.complex128]
    shape_std: NDArray[np.float64]
    scaled: NDArray[np.bool_]
    node: NDArray[np.int64]
    direction: NDArray[np.float64]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n_mode, n_dof = np.size(self.frequency), np.size(self.node)
        for name in ("frequency", "damping", "frequency_std", "damping_std", "shape_std"):
            object.__setattr__(self, name, readonly("FoundModes", name, getattr(self, name), (n_mode,)))
        expected: dict[str, tuple[tuple[int, ...], type]] = {
            "shape": ((n_dof, n_mode), complex),
            "scaled": ((n_mode,), bool),
            "node": ((n_dof,), int),
            "direction": ((n_dof, 3), float),
        }
        for name, (shape, dtype) in expected.items():
            object.__setattr__(self, name, readonly("FoundModes", name, getattr(self, name), shape, dtype))

    @property
    def dofs(self) -> list[tuple[int, ...]]:
        """Point and direction of each component, to be compared."""
        rounded = np.round(1e6 * self.direction).astype(np.int64)
        return [(int(n), *map(int, d)) for n, d in zip(self.node, rounded, strict=True)]


def without_unmeasured(found: FoundModes) -> FoundModes:
    """Leave out components that are zero in every mode: formats with three directions a point fill up with them.

    Raises
    ------
    MeasurementError
        A shape is zero throughout.
    """
    measured = np.any(found.shape != 0.0, axis=1)
    zero = ~np.any(found.shape != 0.0, axis=0)
    if zero.any():
        message = (
            f"{found.source}: the shape of mode {int(np.flatnonzero(zero)[0]) + 1} is zero at every point; leave this "
            "mode out, or export it again"
        )
        raise MeasurementError(message)
    return replace(
        found, shape=found.shape[measured], node=found.node[measured], direction=found.direction[measured]
    )


def joined(parts: Sequence[FoundModes]) -> FoundModes:
    """Put modes of several data sets or files beside each other, at the components that all of them have.

    Raises
    ------
    MeasurementError
        A component stands twice in one of them, or they have none in common.
    """
    first = parts[0]
    places = [{dof: row for row, dof in enumerate(part.dofs)} for part in parts]
    for part, own in zip(parts, places, strict=True):
        if len(own) < part.node.size:
            dof = next(dof for row, dof in enumerate(part.dofs) if own[dof] != row)
            message = (
                f"{part.source}: point {dof[0]} stands twice in the same direction; a shape has each DOF once"
            )
            raise MeasurementError(message)
    common = [dof for dof in places[0] if all(dof in own for own in places)]
    if not common:
        message = f"{first.source}: its modes have no point and direction in common; give those of one test"
        raise MeasurementError(message)
    notes = [note for part in parts for note in part.notes]
    left = max(map(len, places)) - len(common)
    if left:
        notes.append(
            f"{first.source}: {left} components are not in the shapes of all modes; they are left out of all"
        )
    rows = [[own[dof] for dof in common] for own in places]

    def beside(name: str) -> NDArray[np.float64]:
        return np.concatenate([getattr(part, name) for part in parts])

    return FoundModes(
        source=first.source,
        frequency=beside("frequency"),
        damping=beside("damping"),
        frequency_std=beside("frequency_std"),
        damping_std=beside("damping_std"),
        shape=np.concatenate([part.shape[row] for part, row in zip(parts, rows, strict=True)], axis=1),
        shape_std=beside("shape_std"),
        scaled=np.concatenate([part.scaled for part in parts]),
        node=first.node[rows[0]],
        direction=first.direction[rows[0]],
        notes=tuple(dict.fromkeys(notes)),
    )
