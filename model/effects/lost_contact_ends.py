"""Lost contact at the ends: pressure fades towards both ends of the stack.

Enters: pressure p (1 + a f(x, y)), f falls with the square of x, less its mean. Stiffness is affine in a,
    damping a polynomial of it.
Range: a from 0 to 0.95 of the pressure lost at the ends.
Does: raises T1, B1 and B2 by 2 to 3 %, for the force kept presses the middle more, and lowers T2 by 1 to 3 %.
    (Demo stack, nominal strength.)
Mistaken for: clamp_width, suspension.
"""

from __future__ import annotations

import numpy as np

from lamella_arrays import Reals
from model.effects.parts import pressure_change
from model.elements.equations import Assembly, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the change of the pressure field."""
    stack = assembly.stack

    def shape(x: Reals, y: Reals) -> Reals:
        return np.asarray(-((2.0 * x / stack.length) ** 2) + 0.0 * y)

    return pressure_change(assembly, "lost_contact_ends", "end_loss", shape)


EFFECT = Effect(
    name="lost_contact_ends",
    label="lost contact at the ends",
    family="pressure field",
    summary="Lost contact at the ends",
    description=__doc__,
    parameters=(
        Parameter(
            name="end_loss",
            unit="1",
            nominal=0.4,
            lower=0.0,
            upper=0.95,
            source="a from 0 to 0.95 of the pressure lost at the ends",
        ),
    ),
    terms=terms,
)
