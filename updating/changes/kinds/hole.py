"""A hole, or material taken out: stiffness and mass are gone together."""

from __future__ import annotations

import numpy as np

from updating.changes.candidate import Candidates, Kind, at_heights, bumps, needs_laminas, plain
from updating.changes.fields import Fields, Vector
from updating.changes.structure import Part

_TAKES = 2.3
"""Share of the stiffness in a small hole's area that goes with it: between the 2 and 3 of bending and of forces in the
plane, for strains concentrate around it."""
_RADIUS = 0.02  # over the root of the plan's area, of the bell that stands for a small hole


def candidates(fields: Fields, at: Vector) -> Candidates:
    """Return holes, their area being the size."""
    scale = float(np.sqrt(fields.grid.area.sum()))
    bell = bumps(fields.grid, at, np.full(len(at), max(_RADIUS * scale, 1.5 * _step(fields))))
    share = bell.multiply(1.0 / np.maximum(np.asarray(bell.sum(axis=1)), 1e-300)[:, None]).tocsr()
    whole = fields.layers[0]
    area = fields.grid.area.sum()
    return plain(
        at_heights(at, 0.0),
        (
            Part(rows=fields.strain(whole), target="K", weight=-_TAKES * share),
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
