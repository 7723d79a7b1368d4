"""An absorber: a mass on a spring, tuned within or beside the band; something that hangs on or came loose."""

from __future__ import annotations

import numpy as np

from updating.changes.candidate import Candidates, Kind, Part, always, amplitude, at_heights, plain
from updating.changes.fields import Fields, Vector
from updating.changes.kinds.point_masses import at_points

N_TUNED = 120
"""Frequencies to which it may be tuned: evenly in the logarithm from half the band's start to twice its end, some 3 %
apart, for what is lightly damped acts sharply."""


def candidates(fields: Fields, at: Vector) -> Candidates:
    """Return masses on springs across the laminas, up to half of what is there."""
    centre, weight = at_points(fields, at)
    tuned = np.geomspace(0.5 * fields.band[0], 2.0 * fields.band[1], N_TUNED)
    n = len(centre)
    part = Part(
        rows=fields.deflection,
        target="M",
        weight=weight[np.tile(np.arange(n), N_TUNED)],
        resonance=(2.0 * np.pi * np.repeat(tuned, n)) ** 2,
    )
    place = np.tile(at_heights(centre, 0.0), (N_TUNED, 1))
    return plain(place, (part,), n_cell=len(at), upper=0.5 * fields.mass)


KIND = Kind(
    name="absorber",
    label="a mass on a spring",
    quantity="mass",
    unit="kg",
    why_not=always,
    candidates=candidates,
    value=amplitude,
    splits=True,
)
