"""Uneven pressure along: one end of the stack is pressed more than the other.

Bolts of one end that were tightened more, or a clamp there that gave way.

Enters: pressure p (1 + a 2 x / length), so that the clamping force stays. Stiffness is affine in a, damping a
    polynomial of it.
Range: a from -0.95 to 0.95: then one end is hardly pressed.
Does: lowers B2 by 2.8 %, B1 by 1.9 %, T2 by 0.9 to 2.0 % and T1 by 0.5 to 0.7 %, whichever end is pressed more; shapes
    lose their symmetry, which is what tells the end. (Demo stack, nominal strength.)
Mistaken for: lost contact in a corner, a loose clamp, moving mass at the shaker.
"""

from __future__ import annotations

import numpy as np

from lamella_shared import Reals
from model.effects.parts import pressure_change
from model.elements.equations import Assembly, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the change of the pressure field."""

    def shape(x: Reals, y: Reals) -> Reals:
        return np.asarray(x + 0.0 * y)

    return pressure_change(assembly, "pressure_along", "tilt_along", shape)


EFFECT = Effect(
    name="pressure_along",
    label="more pressure at one end",
    family="pressure field",
    summary="Contact pressure that rises from one end of the stack to the other",
    description=__doc__,
    parameters=(
        Parameter(
            name="tilt_along",
            unit="1",
            nominal=0.4,
            lower=-0.95,
            upper=0.95,
            source="a from -0.95 to 0.95: one end is hardly pressed then",
        ),
    ),
    terms=terms,
)
