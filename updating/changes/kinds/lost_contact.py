"""Contact lost in a patch: pressure that fell, oil or dirt between sheets, welds that broke."""

from __future__ import annotations

from functools import partial

from updating.changes.candidate import Kind, gone, needs_contact
from updating.changes.fields import Fields
from updating.changes.kinds.patches import patches

KIND = Kind(
    name="lost_contact",
    label="contact between sheets lost in a patch",
    quantity="share of its stiffness that is gone",
    unit="1",
    why_not=needs_contact,
    candidates=partial(patches, of=Fields.contact, sign=-1.0, upper=2.0),
    value=gone,
    whole=1.0,
)
