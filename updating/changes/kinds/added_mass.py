"""A mass that was added: a sensor, a fitting, something that lies on it."""

from __future__ import annotations

from updating.changes.candidate import Candidates, Kind, Part, always, amplitude, at_heights, plain
from updating.changes.fields import Fields, Vector
from updating.changes.kinds.point_masses import at_points


def candidates(fields: Fields, at: Vector) -> Candidates:
    """Return masses at points, up to half of what is there."""
    centre, weight = at_points(fields, at)
    part = Part(rows=fields.motion(fields.layers[0]), target="M", weight=weight)
    return plain(at_heights(centre, 0.0), (part,), n_cell=len(at), upper=0.5 * fields.mass)


KIND = Kind(
    name="added_mass",
    label="a mass that was added",
    quantity="mass",
    unit="kg",
    why_not=always,
    candidates=candidates,
    value=amplitude,
)
