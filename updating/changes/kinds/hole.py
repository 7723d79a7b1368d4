"""A hole, or material taken out: stiffness and mass are gone together.

Strains concentrate around a hole. Of a small round one in a thin plate, whose loads stay, 2 / (1 - nu) of the energy
goes that was in its area by a mean curvature or a mean strain, and of the rest of the energy 4 / (3 + nu) where it is
bent, 4 / (1 + nu) where it is strained in its plane (Kirsch's solution, and that of a bent plate: Timoshenko and
Woinowsky-Krieger, Theory of Plates and Shells, 1959).
"""

from __future__ import annotations

import numpy as np

from updating.changes.candidate import Candidates, Kind, at_heights, bumps, crossed, needs_laminas, plain
from updating.changes.fields import Fields, Vector
from updating.changes.structure import Part

_RADII = np.array([0.02, 0.05, 0.1])
"""Over the root of the plan's area, of bells over which the energy is averaged: a hole is about as large."""


def candidates(fields: Fields, at: Vector) -> Candidates:
    """Return holes, their area being the size."""
    scale = float(np.sqrt(fields.grid.area.sum()))
    radius, centre = crossed(np.maximum(_RADII * scale, 1.5 * _step(fields)), at)
    bell = bumps(fields.grid, centre, radius)
    share = bell.multiply(1.0 / np.maximum(np.asarray(bell.sum(axis=1)), 1e-300)[:, None]).tocsr()
    whole = fields.layers[0]
    area = fields.grid.area.sum()
    return plain(
        at_heights(centre, 0.0),
        (
            Part(rows=fields.around_hole(whole), target="K", weight=-share),
            Part(rows=fields.motion(whole), target="M", weight=-fields.mass / area * share),
        ),
        n_cell=len(at),
        upper=0.1 * float(area),
    )


def _step(fields: Fields) -> float:
    return float(max(fields.grid.x[1] - fields.grid.x[0], fields.grid.y[1] - fields.grid.y[0]))


def _diameter(candidates: Candidates, found: Vector) -> Vector:  # noqa: ARG001
    """Return the diameter of a round hole of an area, m."""
    return np.asarray(np.sqrt(4.0 * found / np.pi))


KIND = Kind(
    name="hole",
    label="a hole",
    quantity="diameter, were it round",
    unit="m",
    why_not=needs_laminas,
    candidates=candidates,
    value=_diameter,
    exact=None,
)
