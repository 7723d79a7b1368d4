"""A spring to the ground: something that touches the structure and holds it."""

from __future__ import annotations

from updating.changes.candidate import Candidates, Kind, always, plain
from updating.changes.structure import Part, Structure, Vector


def candidates(structure: Structure, at: Vector) -> Candidates:
    """Return springs at points: across laminas, or along each axis."""
    points = structure.pulled(at)
    part = Part(rows=points.rows, target="K", weight=points.weight)
    return plain(points.location, (part,), part=points.part, n_cell=len(at), upper=structure.stiffest)


KINDS = (
    Kind(
        name="spring_to_ground",
        label="a spring to the ground",
        quantity="stiffness",
        unit="N/m",
        why_not=always,
        candidates=candidates,
    ),
)
