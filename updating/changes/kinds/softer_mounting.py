"""An edge that is held less all along: it was clamped anew, or a bolt of the whole jaw has another torque."""

from __future__ import annotations

from updating.changes.candidate import Candidates, Kind, amplitude, needs_supports
from updating.changes.fields import Fields, Vector
from updating.changes.kinds.everywhere import all_over, edges


def candidates(fields: Fields, at: Vector) -> Candidates:  # noqa: ARG001
    """Return each held edge as a whole, against moving and against turning."""
    return all_over(fields, edges(fields), -1.0, 1.0)


KIND = Kind(
    name="softer_mounting",
    label="an edge that is held less all along",
    quantity="share of what holds it that is gone",
    unit="1",
    why_not=needs_supports,
    candidates=candidates,
    on_plan=False,
    value=amplitude,
    local=False,
)
