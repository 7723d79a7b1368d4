"""A clamp that presses less: a bolt that came loose."""

from __future__ import annotations

from functools import partial

import numpy as np

from updating.changes.candidate import Candidates, Kind, gone, needs_clamps
from updating.changes.fields import Vector
from updating.changes.kinds.clamp_force import at_clamps


def _share(clamps: Candidates, found: Vector) -> Vector:
    """Return the share of the contact's stiffness that goes with an amplitude, which may go with the clamp's mass."""
    return np.asarray(clamps.extra.reshape(-1, *(1,) * (found.ndim - 1)) * found)


def _gone(clamps: Candidates, found: Vector) -> Vector:
    """Return the share that is gone under the clamp."""
    return gone(clamps, _share(clamps, found))


KIND = Kind(
    name="loose_clamp",
    label="a clamp that presses less",
    quantity="share of the contact's stiffness under it that is gone",
    unit="1",
    why_not=needs_clamps,
    candidates=partial(at_clamps, sign=-1.0, upper=1.5, rides=True),
    on_plan=False,
    value=_gone,
    exact=_share,
    whole=1.0,
)
