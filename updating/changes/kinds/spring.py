"""A spring to the ground: something that touches the structure and holds it."""

from __future__ import annotations

import numpy as np

from updating.changes.candidate import Candidates, Kind, Part, always, amplitude, at_heights, plain
from updating.changes.fields import Fields, Vector
from updating.changes.kinds.point_masses import at_points


def candidates(fields: Fields, at: Vector) -> Candidates:
    """Return springs across the laminas at points."""
    centre, weight = at_points(fields, at)
    part = Part(rows=fields.deflection, target="K", weight=weight)
    return plain(at_heights(centre, 0.0), (part,), n_cell=len(at), upper=np.inf)


KIND = Kind(
    name="spring_to_ground",
    label="a spring to the ground",
    quantity="stiffness",
    unit="N/m",
    why_not=always,
    candidates=candidates,
    value=amplitude,
)
