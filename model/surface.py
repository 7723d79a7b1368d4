"""Displacement of chosen laminas on a grid of points, for wireframes and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.arrays import readonly
from model.errors import SolveError
from model.mesh import FIELDS
from model.modes import Modes
from model.reduction import ReducedSystem


@dataclass(frozen=True, eq=False, kw_only=True)
class Surface:
    """A mode's displacement on a grid of points of some laminas.

    Attributes
    ----------
    location : (n_lamina, n_x, n_y, 3) float
        The points at rest, m.
    displacement : (n_lamina, n_x, n_y, 3) float
        Their mass-normalised displacement along x, y and z, 1/sqrt(kg).
    """

    location: NDArray[np.float64]
    displacement: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in ("location", "displacement"):
            array = readonly("Surface", name, getattr(self, name), (None, None, None, 3))
            object.__setattr__(self, name, array)


def mode_surface(
    system: ReducedSystem,
    modes: Modes,
    mode: int,
    *,
    lamina: Sequence[int],
    n_x: int = 41,
    n_y: int = 9,
) -> Surface:
    """Sample a mode on an even grid of points on some laminas.

    Parameters
    ----------
    system : ReducedSystem
        The reduced stack.
    modes : Modes
        Modes of that system.
    mode : int
        Column of `modes.shape`, from 0.
    lamina : sequence of int
        Laminas to sample, 0 the bottom one; negative ones count from the top.
    n_x, n_y : int
        Number of points along x and y.

    Raises
    ------
    SolveError
        There is no such mode or lamina.
    """
    stack = system.stack
    if not 0 <= mode < modes.frequency.size:
        message = f"mode = {mode}: the modes are numbered from 0 to {modes.frequency.size - 1}"
        raise SolveError(message)
    chosen = np.asarray(lamina, dtype=np.intp)
    if chosen.size == 0 or chosen.min() < -stack.n_lamina or chosen.max() >= stack.n_lamina:
        message = f"lamina = {list(lamina)}: the laminas are numbered from 0 to {stack.n_lamina - 1}"
        raise SolveError(message)
    chosen = chosen % stack.n_lamina
    x = np.linspace(-stack.length / 2.0, stack.length / 2.0, n_x)
    y = np.linspace(-stack.width / 2.0, stack.width / 2.0, n_y)
    plan = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    points = np.tile(plan, (chosen.size, 1))
    index = np.repeat(chosen, plan.shape[0])
    coordinate = system.basis @ modes.coordinate[:, mode]
    displacement = np.column_stack([system.field_rows(f, index, points) @ coordinate for f in FIELDS])
    location = np.column_stack([points, stack.lamina_z[index]])
    shape = (chosen.size, n_x, n_y, 3)
    return Surface(location=location.reshape(shape), displacement=displacement.reshape(shape))
