"""A mass that was added, such as a sensor or a fitting, or taken away, no more than is there."""

from __future__ import annotations

from functools import partial

from updating.changes.candidate import Candidates, Kind, always, plain
from updating.changes.structure import Part, Structure, Vector


def _masses(structure: Structure, at: Vector, *, sign: float) -> Candidates:
    """Return masses at points that were added (sign 1), up to half of what is there, or taken away (-1)."""
    points = structure.tied(at)
    part = Part(rows=points.rows, target="M", weight=points.weight, sign=sign)
    upper = 0.5 * structure.mass if sign > 0.0 else structure.removable
    return plain(points.location, (part,), part=points.part, n_cell=len(at), upper=upper)


KINDS = tuple(
    Kind(
        name=name, label=label, quantity="mass", unit="kg", why_not=always, candidates=partial(_masses, sign=sign),
    )
    for name, label, sign in (
        ("added_mass", "a mass that was added", 1.0),
        ("removed_mass", "a mass that was taken away", -1.0),
    )
)  # fmt: skip
