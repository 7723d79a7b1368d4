"""A clamp that presses more: a bolt that was tightened."""

from __future__ import annotations

from updating.changes.candidate import Candidates, Kind, amplitude, needs_clamps
from updating.changes.fields import Fields, Vector
from updating.changes.kinds.clamp_force import at_clamps


def candidates(fields: Fields, at: Vector) -> Candidates:  # noqa: ARG001
    """Return each clamp with more contact stiffness under it, by a ratio."""
    return at_clamps(fields, 1.0, 5.0)


KIND = Kind(
    name="tight_clamp",
    label="a clamp that presses more",
    quantity="share by which the contact under it is stiffer",
    unit="1",
    why_not=needs_clamps,
    candidates=candidates,
    on_plan=False,
    value=amplitude,
)
