"""A mass that was taken away, no more than is there: of a clamp or a fitting, or material that holds nothing."""

from __future__ import annotations

from updating.changes.candidate import Candidates, Kind, always, amplitude, plain
from updating.changes.structure import Part, Structure, Vector


def candidates(structure: Structure, at: Vector) -> Candidates:
    """Return masses taken away at points."""
    points = structure.tied(at)
    part = Part(rows=points.rows, target="M", weight=points.weight, sign=-1.0)
    return plain(points.location, (part,), part=points.part, n_cell=len(at), upper=structure.removable)


KIND = Kind(
    name="removed_mass",
    label="a mass that was taken away",
    quantity="mass",
    unit="kg",
    why_not=always,
    candidates=candidates,
    value=amplitude,
)
