"""A patch of more stiffness: laminas thicker or doubled there."""

from __future__ import annotations

from functools import partial

from updating.changes.candidate import Kind, amplitude, needs_laminas
from updating.changes.fields import Fields
from updating.changes.kinds.patches import patches

KIND = Kind(
    name="stiffer_patch",
    label="a patch of more stiffness",
    quantity="share by which it is stiffer",
    unit="1",
    why_not=needs_laminas,
    candidates=partial(patches, of=Fields.strain, sign=1.0, upper=10.0),
    value=amplitude,
)
