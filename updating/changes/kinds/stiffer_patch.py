"""A patch of more stiffness: laminas thicker or doubled there."""

from __future__ import annotations

from updating.changes.candidate import Candidates, Kind, always, amplitude
from updating.changes.fields import Fields, Vector
from updating.changes.kinds.patches import patches


def candidates(fields: Fields, at: Vector) -> Candidates:
    """Return patches whose laminas are stiffer by a share."""
    return patches(fields, at, fields.strain, 1.0, upper=10.0)


KIND = Kind(
    name="stiffer_patch",
    label="a patch of more stiffness",
    quantity="share by which it is stiffer",
    unit="1",
    why_not=always,
    candidates=candidates,
    value=amplitude,
)
