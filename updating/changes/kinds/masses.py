"""Changes at a point: masses that were added, taken away or hang on a spring, and springs to the ground."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from updating.changes.candidate import Candidates, Kind, Part, always, amplitude, at_heights, plain
from updating.changes.fields import Fields, Vector


def at_points(fields: Fields, at: Vector) -> tuple[Vector, Any]:
    """Return locations, (n, 2), and the weights of a point at each, (n, n_point)."""
    which, share = fields.grid.shares(at)
    row = np.broadcast_to(np.arange(len(at))[:, None], which.shape)
    weight = sp.coo_array(
        (share.ravel(), (row.ravel(), which.ravel())), shape=(len(at), len(fields.grid.point))
    )
    return at, weight.tocsr()


def added_mass_candidates(fields: Fields, at: Vector) -> Candidates:
    """Return masses at points, up to half of what is there."""
    centre, weight = at_points(fields, at)
    part = Part(rows=fields.motion(fields.layers[0]), target="M", weight=weight)
    return plain(at_heights(centre, 0.0), (part,), n_cell=len(at), upper=0.5 * fields.mass)


ADDED_MASS = Kind(
    name="added_mass",
    label="a mass that was added",
    quantity="mass",
    unit="kg",
    why_not=always,
    candidates=added_mass_candidates,
    value=amplitude,
)

_NEAR = 0.1  # over the root of the plan's area: what lies within belongs to a place


def removed_mass_candidates(fields: Fields, at: Vector) -> Candidates:
    """Return masses taken away at points."""
    centre, weight = at_points(fields, at)
    part = Part(rows=fields.motion(fields.layers[0]), target="M", weight=-weight)
    clamps = max((clamp.mass for clamp in fields.stack.clamps), default=0.0)
    return plain(
        at_heights(centre, 0.0), (part,), n_cell=len(at), upper=float(np.pi * _NEAR**2 * fields.mass + clamps)
    )


REMOVED_MASS = Kind(
    name="removed_mass",
    label="a mass that was taken away",
    quantity="mass",
    unit="kg",
    why_not=always,
    candidates=removed_mass_candidates,
    value=amplitude,
)

N_TUNED = 120
"""Frequencies to which it may be tuned: evenly in the logarithm from half the band's start to twice its end, some 3 %
apart, for what is lightly damped acts sharply."""


def absorber_candidates(fields: Fields, at: Vector) -> Candidates:
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


ABSORBER = Kind(
    name="absorber",
    label="a mass on a spring",
    quantity="mass",
    unit="kg",
    why_not=always,
    candidates=absorber_candidates,
    value=amplitude,
    splits=True,
)


def spring_candidates(fields: Fields, at: Vector) -> Candidates:
    """Return springs across the laminas at points."""
    centre, weight = at_points(fields, at)
    part = Part(rows=fields.deflection, target="K", weight=weight)
    return plain(at_heights(centre, 0.0), (part,), n_cell=len(at), upper=np.inf)


SPRING = Kind(
    name="spring_to_ground",
    label="a spring to the ground",
    quantity="stiffness",
    unit="N/m",
    why_not=always,
    candidates=spring_candidates,
    value=amplitude,
)
