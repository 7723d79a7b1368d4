"""A held edge that is firmer over a part of its length: a bolt that was tightened, a gap that was closed."""

from __future__ import annotations

from updating.changes.candidate import Candidates, Kind, amplitude, needs_supports
from updating.changes.fields import Fields, Vector
from updating.changes.kinds.held_edges import on_edges


def candidates(fields: Fields, at: Vector) -> Candidates:  # noqa: ARG001
    """Return parts of edges that hold more by a ratio."""
    return on_edges(fields, 1.0, 10.0)


KIND = Kind(
    name="firmer_edge",
    label="a held edge that is firmer over a part of it",
    quantity="share by which it is held firmer",
    unit="1",
    why_not=needs_supports,
    candidates=candidates,
    on_plan=False,
    value=amplitude,
)
