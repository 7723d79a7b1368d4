"""An absorber: a mass on a spring, tuned within or beside the band; something that hangs on or came loose."""

from __future__ import annotations

import numpy as np

from updating.changes.candidate import Candidates, Kind, always, plain
from updating.changes.structure import Part, Structure, Vector


def candidates(structure: Structure, at: Vector) -> Candidates:
    """Return masses on springs, up to half of what is there: across laminas, or along each axis."""
    # Frequencies to which it may be tuned: evenly in the logarithm from half the band's start to twice its end, some
    # 3 % apart, for what is lightly damped acts sharply
    n_tuned = 120
    points = structure.pulled(at)
    tuned = np.geomspace(0.5 * structure.band[0], 2.0 * structure.band[1], n_tuned)
    n = len(points.location)
    part = Part(
        rows=points.rows,
        target="M",
        weight=points.weight[np.tile(np.arange(n), n_tuned)],
        resonance=(2.0 * np.pi * np.repeat(tuned, n)) ** 2,
    )
    return plain(
        np.tile(points.location, (n_tuned, 1)),
        (part,),
        part=np.tile(points.part, n_tuned),
        n_cell=len(at),
        upper=0.5 * structure.mass,
    )


KINDS = (
    Kind(
        name="absorber",
        label="a mass on a spring",
        quantity="mass",
        unit="kg",
        why_not=always,
        candidates=candidates,
        splits=True,
    ),
)
