"""Contact gained in a patch: glue, a weld, or more pressure between sheets."""

from __future__ import annotations

from functools import partial

from updating.changes.candidate import Kind, amplitude, needs_contact
from updating.changes.fields import Fields
from updating.changes.kinds.patches import patches

KIND = Kind(
    name="glued_patch",
    label="sheets that hold together more in a patch, as by glue",
    quantity="share by which their contact is stiffer",
    unit="1",
    why_not=needs_contact,
    candidates=partial(patches, of=Fields.contact, sign=1.0, upper=20.0),
    value=amplitude,
)
