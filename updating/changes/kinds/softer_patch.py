"""A patch of less stiffness: laminas thinner, worn, broken or heated there."""

from __future__ import annotations

from functools import partial

from updating.changes.candidate import Kind, gone, needs_laminas
from updating.changes.fields import Fields
from updating.changes.kinds.patches import patches

KIND = Kind(
    name="softer_patch",
    label="a patch of less stiffness",
    quantity="share of its stiffness that is gone",
    unit="1",
    why_not=needs_laminas,
    candidates=partial(patches, of=Fields.strain, sign=-1.0),
    value=gone,
    whole=1.0,
)
