"""A mass that was taken away, no more than is there: of a clamp or a fitting, or material that holds nothing."""

from __future__ import annotations

import numpy as np

from updating.changes.candidate import Candidates, Kind, Part, always, amplitude, at_heights, plain
from updating.changes.fields import Fields, Vector
from updating.changes.kinds.point_masses import at_points

_NEAR = 0.1  # over the root of the plan's area: what lies within belongs to a place


def candidates(fields: Fields, at: Vector) -> Candidates:
    """Return masses taken away at points."""
    centre, weight = at_points(fields, at)
    part = Part(rows=fields.motion(fields.layers[0]), target="M", weight=-weight)
    clamps = max((clamp.mass for clamp in fields.stack.clamps), default=0.0)
    return plain(
        at_heights(centre, 0.0), (part,), n_cell=len(at), upper=float(np.pi * _NEAR**2 * fields.mass + clamps)
    )


KIND = Kind(
    name="removed_mass",
    label="a mass that was taken away",
    quantity="mass",
    unit="kg",
    why_not=always,
    candidates=candidates,
    value=amplitude,
)
