"""A clamp that presses more: a bolt that was tightened."""

from __future__ import annotations

from functools import partial

from updating.changes.candidate import Kind, amplitude, needs_clamps
from updating.changes.kinds.clamp_force import at_clamps

KIND = Kind(
    name="tight_clamp",
    label="a clamp that presses more",
    quantity="share by which the contact under it is stiffer",
    unit="1",
    why_not=needs_clamps,
    candidates=partial(at_clamps, sign=1.0, upper=5.0),
    on_plan=False,
    value=amplitude,
)
