"""A held edge that is firmer over a part of its length: a bolt that was tightened, a gap that was closed."""

from __future__ import annotations

from functools import partial

from updating.changes.candidate import Kind, amplitude, needs_supports
from updating.changes.kinds.held_edges import on_edges

KIND = Kind(
    name="firmer_edge",
    label="a held edge that is firmer over a part of it",
    quantity="share by which it is held firmer",
    unit="1",
    why_not=needs_supports,
    candidates=partial(on_edges, sign=1.0, upper=10.0),
    on_plan=False,
    value=amplitude,
)
