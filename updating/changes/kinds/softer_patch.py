"""A patch of less stiffness: laminas thinner, worn, broken or heated there."""

from __future__ import annotations

from updating.changes.candidate import Candidates, Kind, always, gone
from updating.changes.fields import Fields, Vector
from updating.changes.kinds.patches import patches


def candidates(fields: Fields, at: Vector) -> Candidates:
    """Return patches whose laminas are less stiff by a share."""
    return patches(fields, at, fields.strain, -1.0)


KIND = Kind(
    name="softer_patch",
    label="a patch of less stiffness",
    quantity="share of its stiffness that is gone",
    unit="1",
    why_not=always,
    candidates=candidates,
    value=gone,
    whole=1.0,
)
