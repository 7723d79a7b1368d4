"""An edge that is held more all along: it was clamped anew, or a bolt of the whole jaw has another torque."""

from __future__ import annotations

from functools import partial

from updating.changes.candidate import Kind, amplitude, needs_supports
from updating.changes.kinds.everywhere import all_over, edges

KIND = Kind(
    name="firmer_mounting",
    label="an edge that is held more all along",
    quantity="share by which it is held firmer",
    unit="1",
    why_not=needs_supports,
    candidates=partial(all_over, of=edges, sign=1.0, upper=10.0),
    on_plan=False,
    value=amplitude,
    local=False,
)
