"""More of a stated term: a support or joint that is firmer, a part that is stiffer or heavier, or is new."""

from __future__ import annotations

from functools import partial

from updating.changes.candidate import Kind, amplitude
from updating.changes.kinds.stated_terms import of_terms, why_not

KIND = Kind(
    name="greater_term",
    label="more of a stated term",
    quantity="share of it, or of what the file states, that was added",
    unit="1",
    why_not=why_not,
    candidates=partial(of_terms, sign=1.0, upper=10.0),
    on_plan=False,
    value=amplitude,
    local=False,
)
