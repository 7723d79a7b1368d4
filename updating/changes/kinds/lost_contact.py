"""Contact lost in a patch: pressure that fell, oil or dirt between sheets, welds that broke."""

from __future__ import annotations

from updating.changes.candidate import Candidates, Kind, gone, needs_contact
from updating.changes.fields import Fields, Vector
from updating.changes.kinds.patches import patches


def candidates(fields: Fields, at: Vector) -> Candidates:
    """Return patches of interfaces that hold less by a share."""
    return patches(fields, at, fields.contact, -1.0, upper=2.0)


KIND = Kind(
    name="lost_contact",
    label="contact between sheets lost in a patch",
    quantity="share of its stiffness that is gone",
    unit="1",
    why_not=needs_contact,
    candidates=candidates,
    value=gone,
    whole=1.0,
)
