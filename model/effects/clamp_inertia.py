"""Clamp rotary inertia about the long axis: bars and bolts that stand off the stack turn with its sections.

At one station on each side of the middle, x = +-0.4 s L, a rotary inertia J turns with the slope dw/dy of the
laminas under it, over the length of a clamp's footprint.

Enters: mass matrix, with the slope along y of the plane that lies closest to w of all laminas there. Affine
    in J. The slope at a station is shared among those at the nearest three of nine fixed places, smoothly as
    it moves; a sum of their inertias would have kinks, at which fits stop, and be off by 3 % of a frequency.
Range: bars and bolts of 1 to 2 kg at 40 to 120 mm from the axis, m r**2; J up to 0.03 kg m2 at each station.
Does: lowers T1 by 17 % and leaves B1 and B2, and T2 as well at the nominal station, where it hardly turns.
    In the published data the fit then raises G_f and brings the bending modes up. (Demo stack, nominal
    strength.)
Mistaken for: a shear stiffness across the width that is too high (contact_direction), lost contact at the
    edges.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from model.effects.parts import mean_lamina, shared_among, turn_of
from model.elements.equations import Assembly, Formula, Kron, Term, Theta
from model.stack.effect import Effect, Parameter

_GRID = np.linspace(0.0, 1.0, 9)


def _of_places(t: Theta, i: int, j: int) -> Any:
    shares = shared_among(t["clamp_station"], _GRID.size)
    return t["clamp_roll_inertia"] * shares[i] * shares[j]


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the inertia of a unit J that turns with one place, and with two that share a station."""
    sharing = 2  # how far apart places are that may share a station
    footprint = 1.0 / 6.0  # of the length, where no clamp of the stack has one
    reach = 0.4  # of the length, from the middle to the outermost station
    stack, found = assembly.stack, []
    pressed = max((clamp.footprint[0] for clamp in stack.clamps), default=0.0)
    z, size = mean_lamina(stack), (pressed or footprint * stack.length, stack.width)
    rows = [
        [turn_of(assembly, (side * reach * station * stack.length, 0.0), size, "y", tapered=True) for side in (-1, 1)]
        for station in _GRID
    ]  # fmt: skip
    for i, here in enumerate(rows):
        for j, there in enumerate(rows[i : i + 1 + sharing], i):
            products = (one.T @ other for one, other in zip(here, there, strict=True))
            planar = sum(product if i == j else product + product.T for product in products)
            found.append(
                Term(
                    name=f"clamp_inertia at {_GRID[i]:.3f} and {_GRID[j]:.3f}",
                    target="M",
                    factor=Formula(partial(_of_places, i=i, j=j)),
                    krons=(Kron(row="w", column="w", z=z, planar=planar.tocsr()),),
                )
            )
    return tuple(found)


EFFECT = Effect(
    name="clamp_inertia",
    label="clamp rotary inertia",
    family="inertia",
    summary="Clamp rotary inertia about the long axis",
    description=__doc__,
    parameters=(
        Parameter(
            name="clamp_roll_inertia",
            unit="kg m2",
            nominal=0.003,
            lower=0.0,
            upper=0.03,
            source="bars and bolts of 1 to 2 kg at 40 to 120 mm from the axis, m r**2",
        ),
        Parameter(
            name="clamp_station",
            unit="1",
            nominal=0.6,
            lower=0.0,
            upper=1.0,
            neutral=0.6,
            source="0 in the middle, 1 where the clamp ends with the stack; clamps stand anywhere along it",
            sampled=True,
            n_start=3,
        ),
    ),
    terms=terms,
)
