"""A held edge that gives way over a part of its length: a jaw, a weld or a bolt that holds less there."""

from __future__ import annotations

from updating.changes.candidate import Candidates, Kind, gone, needs_supports
from updating.changes.fields import Fields, Vector
from updating.changes.kinds.held_edges import on_edges


def candidates(fields: Fields, at: Vector) -> Candidates:  # noqa: ARG001
    """Return parts of edges that hold less by a share; strains concentrate beside them, so that it may be above 1."""
    return on_edges(fields, -1.0, 3.0)


KIND = Kind(
    name="softer_edge",
    label="a held edge that gives way over a part of it",
    quantity="share of what holds it that is gone",
    unit="1",
    why_not=needs_supports,
    candidates=candidates,
    on_plan=False,
    value=gone,
    whole=1.0,
)
