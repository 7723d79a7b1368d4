"""Lost contact in a corner: one corner of the stack is not pressed.

Enters: pressure p (1 + a f(x, y)), f a bell about the corner at the highest x and y, turned down, less its
    mean. Stiffness is affine in a, damping a polynomial of it.
Range: a from 0 to 0.95 of the pressure lost in the corner.
Does: raises B1 and B2 by 0.6 to 0.7 % and lowers T1 by 0.2 % and T2 by 0.6 to 0.9 %; shapes lose their
    symmetry, which is what tells it. (Demo stack, nominal strength.)
Mistaken for: a one-sided mass (stinger_mass, accelerometer_fixed).
"""

from __future__ import annotations

import numpy as np

from lamella_shared import Reals
from model.effects.parts import pressure_change
from model.elements.equations import Assembly, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the change of the pressure field."""
    stack = assembly.stack

    def shape(x: Reals, y: Reals) -> Reals:
        along = (x - stack.length / 2.0) / (stack.length / 6.0)
        across = (y - stack.width / 2.0) / (stack.width / 3.0)
        return np.asarray(-np.exp(-0.5 * along**2 - 0.5 * across**2))

    return pressure_change(assembly, "lost_contact_corner", "corner_loss", shape)


EFFECT = Effect(
    name="lost_contact_corner",
    label="lost contact in a corner",
    family="pressure field",
    summary="Lost contact in a corner",
    description=__doc__,
    parameters=(
        Parameter(
            name="corner_loss",
            unit="1",
            nominal=0.5,
            lower=0.0,
            upper=0.95,
            source="a from 0 to 0.95 of the pressure lost in the corner",
        ),
    ),
    terms=terms,
)
