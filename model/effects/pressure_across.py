"""Uneven pressure across: one long side of the stack is pressed more than the other.

Bolts of one side that were tightened more, or clamps that stand askew.

Enters: pressure p (1 + a 2 y / width), so that the clamping force stays. Stiffness is affine in a, damping a
    polynomial of it.
Range: a from -0.95 to 0.95: then one side is hardly pressed.
Does: lowers T1 by 2.7 %, B1 and B2 by 0.5 to 0.8 % and T2 by 0.2 to 0.4 %, whichever side is pressed more; shapes lose
    their symmetry, which is what tells the side. (Demo stack, nominal strength.)
Mistaken for: edge_pressure, a shear stiffness across the width that is too high (contact_direction), sensors of
    one side that read too little.
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
        return np.asarray(y + 0.0 * x)

    return pressure_change(assembly, "pressure_across", "tilt_across", shape)


EFFECT = Effect(
    name="pressure_across",
    label="more pressure on one side",
    family="pressure field",
    summary="Contact pressure that rises from one side of the stack to the other",
    description=__doc__,
    parameters=(
        Parameter(
            name="tilt_across",
            unit="1",
            nominal=0.4,
            lower=-0.95,
            upper=0.95,
            source="a from -0.95 to 0.95: one side is hardly pressed then",
        ),
    ),
    terms=terms,
)
