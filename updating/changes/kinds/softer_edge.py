"""A held edge that gives way over a part of its length: a jaw, a weld or a bolt that holds less there."""

from __future__ import annotations

from functools import partial

from updating.changes.candidate import Kind, gone, needs_supports
from updating.changes.kinds.held_edges import on_edges

KIND = Kind(
    name="softer_edge",
    label="a held edge that gives way over a part of it",
    quantity="share of what holds it that is gone",
    unit="1",
    why_not=needs_supports,
    candidates=partial(on_edges, sign=-1.0, upper=3.0),
    on_plan=False,
    value=gone,
    whole=1.0,
)
