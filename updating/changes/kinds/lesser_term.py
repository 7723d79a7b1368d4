"""Less of a stated term: a support or joint that gives way, a part that lost stiffness or mass."""

from __future__ import annotations

from functools import partial

from updating.changes.candidate import Kind, amplitude
from updating.changes.kinds.stated_terms import of_terms, why_not

KIND = Kind(
    name="lesser_term",
    label="less of a stated term",
    quantity="share of it that is gone",
    unit="1",
    why_not=why_not,
    candidates=partial(of_terms, sign=-1.0, upper=1.0),
    on_plan=False,
    value=amplitude,
    whole=1.0,
    local=False,
)
