"""Less stiffness of all interfaces: pressure that fell everywhere, or another surface."""

from __future__ import annotations

from functools import partial

from updating.changes.candidate import Kind, amplitude, needs_contact
from updating.changes.kinds.everywhere import all_over, interfaces

KIND = Kind(
    name="softer_contact",
    label="less contact stiffness all over, as by less pressure",
    quantity="share of it that is gone",
    unit="1",
    why_not=needs_contact,
    candidates=partial(all_over, of=interfaces, sign=-1.0, upper=1.0),
    on_plan=False,
    value=amplitude,
    local=False,
)
