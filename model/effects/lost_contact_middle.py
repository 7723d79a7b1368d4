"""Lost contact in the middle: laminas do not touch in the middle of the stack.

Enters: pressure p (1 + a f(x, y)), f a bell of a sixth of the length about x = 0, turned down, less its mean.
    Stiffness is affine in a, damping a polynomial of it.
Range: a from 0 to 0.95 of the pressure lost in the middle.
Does: lowers B2 by 12 %, B1 by 4 % and T1 by 3 %, and leaves T2 or raises it by 1 %. Nearly the same between
    torques. (Demo stack, nominal strength.)
Mistaken for: clamp_width, waviness, contact_direction.
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
        return np.asarray(-np.exp(-0.5 * (x / (stack.length / 6.0)) ** 2) + 0.0 * y)

    return pressure_change(assembly, "lost_contact_middle", "middle_loss", shape)


EFFECT = Effect(
    name="lost_contact_middle",
    label="lost contact in the middle",
    family="pressure field",
    summary="Lost contact in the middle",
    description=__doc__,
    parameters=(
        Parameter(
            name="middle_loss",
            unit="1",
            nominal=0.4,
            lower=0.0,
            upper=0.95,
            source="a from 0 to 0.95 of the pressure lost in the middle",
        ),
    ),
    terms=terms,
)
