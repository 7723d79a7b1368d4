"""Contact gained in a patch: glue, a weld, or more pressure between sheets."""

from __future__ import annotations

from updating.changes.candidate import Candidates, Kind, amplitude, needs_contact
from updating.changes.fields import Fields, Vector
from updating.changes.kinds.patches import patches


def candidates(fields: Fields, at: Vector) -> Candidates:
    """Return patches of interfaces that hold more by a ratio; what is glued hardly slips, whatever the glue."""
    return patches(fields, at, fields.contact, 1.0, upper=20.0)


KIND = Kind(
    name="glued_patch",
    label="sheets that hold together more in a patch, as by glue",
    quantity="share by which their contact is stiffer",
    unit="1",
    why_not=needs_contact,
    candidates=candidates,
    value=amplitude,
)
