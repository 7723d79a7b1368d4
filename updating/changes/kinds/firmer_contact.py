"""More stiffness of all interfaces: pressure that rose everywhere, or another surface."""

from __future__ import annotations

from functools import partial

from updating.changes.candidate import Kind, amplitude, needs_contact
from updating.changes.kinds.everywhere import all_over, interfaces

KIND = Kind(
    name="firmer_contact",
    label="more contact stiffness all over, as by more pressure",
    quantity="share by which it is stiffer",
    unit="1",
    why_not=needs_contact,
    candidates=partial(all_over, of=interfaces, sign=1.0, upper=10.0),
    on_plan=False,
    value=amplitude,
    local=False,
)
