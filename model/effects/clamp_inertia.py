"""Clamp rotary inertia about the long axis: bars and bolts that stand off the stack turn with its sections.

At one station on each side of the middle, x = +-0.4 s L, a rotary inertia J turns with the slope dw/dy of the
laminas under it, over a fifth of the length, less towards its ends.

Enters: mass matrix, with the slope along y of the plane that lies closest to w of all laminas there. Affine
    in J; the station moves the inertia between eleven fixed places, linearly between neighbours.
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

from model.effects.parts import hats, mean_lamina, square, turn_of
from model.elements.equations import Assembly, Formula, Term, Theta
from model.stack.effect import Effect, Parameter

_GRID = np.linspace(0.0, 1.0, 11)
_SHARE = 0.2  # of the length that a clamp covers, half of it well; over less, upper modes rest on the elements there


def _at_station(t: Theta, i: int) -> Any:
    return t["clamp_roll_inertia"] * hats(t["clamp_station"], _GRID)[i]


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the inertia of a unit J at each fixed place."""
    stack, found = assembly.stack, []
    z = mean_lamina(stack)
    half, size = stack.length / 2.0, (_SHARE * stack.length, stack.width)
    for i, station in enumerate(_GRID):
        inward = station * (half - size[0] / 2.0)  # the strip stays on the plan
        rows = (turn_of(assembly, (x, 0.0), size, "y", tapered=True) for x in (-inward, inward))
        krons = tuple(square("w", row, z) for row in rows)
        factor = Formula(partial(_at_station, i=i))
        found.append(Term(name=f"clamp_inertia at {station:.1f}", target="M", factor=factor, krons=krons))
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
        ),
    ),
    terms=terms,
)
