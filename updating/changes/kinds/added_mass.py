"""A mass that was added: a sensor, a fitting, something that lies on it."""

from __future__ import annotations

from updating.changes.candidate import Candidates, Kind, always, amplitude, plain
from updating.changes.structure import Part, Structure, Vector


def candidates(structure: Structure, at: Vector) -> Candidates:
    """Return masses at points, up to half of what is there."""
    points = structure.tied(at)
    part = Part(rows=points.rows, target="M", weight=points.weight)
    return plain(points.location, (part,), part=points.part, n_cell=len(at), upper=0.5 * structure.mass)


KIND = Kind(
    name="added_mass",
    label="a mass that was added",
    quantity="mass",
    unit="kg",
    why_not=always,
    candidates=candidates,
    value=amplitude,
)
