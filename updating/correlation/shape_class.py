"""Classes of mode shapes, such as "bending 1", by their motion on a grid of the stack."""

from __future__ import annotations

import numpy as np

from lamella_shared import Integers, Reals
from model import Modes, Observation, Observed, ReducedSystem, Stack, solve_modes

CLASS_STATIONS, CLASS_ROWS = 41, 3


def class_grid(stack: Stack) -> Observation:
    """Return the DOFs from which modes are named: w and u, v on stations by rows at mid-height.

    The DOFs are ordered direction (z, x, y), station, row.
    """
    x = np.linspace(-0.5, 0.5, CLASS_STATIONS) * stack.length
    y = np.linspace(-0.5, 0.5, CLASS_ROWS) * stack.width
    location = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    return Observation(
        node=np.arange(3 * len(location)),
        location=np.tile(location, (3, 1)),
        direction=np.repeat(np.eye(3)[[2, 0, 1]], len(location), axis=0),
    )


def shape_classes(modes: Modes) -> tuple[str, ...]:
    """Name each mode sampled on `class_grid`.

    Returns "bending n", "torsion n" (n counts the order from 1), or "other" where the motion at mid-height is mostly in
    the plane of the sheets.
    """
    field = modes.shape.reshape(3, CLASS_STATIONS, CLASS_ROWS, -1)
    names = []
    for r in range(field.shape[-1]):
        w, in_plane = field[0, ..., r], field[1:, ..., r]
        even, odd = w[:, 1], (w[:, -1] - w[:, 0]) / 2
        if np.sum(w**2) < np.sum(in_plane**2):
            names.append("other")
        elif np.sum(even**2) >= np.sum(odd**2):
            names.append(_order("bending", _n_sign_change(even) - 1))
        else:
            names.append(_order("torsion", _n_sign_change(odd)))
    return tuple(names)


def solve_by_class(
    system: ReducedSystem, grid: Observation | Observed, wanted: tuple[str, ...], *, G_f: float, n_mode: int = 22
) -> tuple[Modes, Integers]:
    """Elastic modes of the model and the column of the lowest mode of each wanted class; -1 where there is none."""
    modes = solve_modes(system, G_f=G_f, d_f=0.0, n_mode=n_mode, observation=grid).elastic()
    names = shape_classes(modes)
    return modes, np.array([names.index(name) if name in names else -1 for name in wanted], np.int64)


def _order(family: str, order: int) -> str:
    return f"{family} {order}" if order > 0 else "other"


def _n_sign_change(values: Reals) -> int:
    sign = np.sign(values[np.abs(values) > 1e-3 * np.max(np.abs(values))])
    return int(np.count_nonzero(np.diff(sign)))
