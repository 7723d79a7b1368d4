"""Lost contact at the ends: pressure fades towards both ends of the stack.

Enters: pressure p (1 + a f(x, y)), f falls with a power of the distance from the middle, less its mean. Stiffness is
    affine in a, damping a polynomial of it. Between four powers the field is interpolated (quadratic splines).
Range: a from 0 to 0.95 of the pressure lost at the ends; powers from 1, an even fall, to 8, a loss at the last tenth.
Does: raises T1, B1 and B2 by 2 to 3 %, for the force kept presses the middle more, and lowers T2 by 1 to 3 %.
    (Demo stack, nominal strength.)
Mistaken for: clamp_width, suspension.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from lamella_shared import Reals
from model.effects.parts import Size, pressure_change
from model.elements.equations import Assembly, Term
from model.stack.effect import Effect, Parameter

_POWER = Size(name="end_power", usual=2.0, octaves=(-1.0, 2.0), n=4)


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the change of the pressure field."""
    length = assembly.stack.length

    def fall(x: Reals, y: Reals, power: float) -> Reals:
        return np.asarray(-(np.abs(2.0 * x / length) ** power) + 0.0 * y)

    return tuple(
        term
        for i, (power, share) in enumerate(_POWER.fields)
        for term in pressure_change(
            assembly, f"lost_contact_ends {i + 1}", "end_loss", partial(fall, power=power), share
        )
    )


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
        _POWER.parameter("1 where the pressure falls evenly from the middle, 8 where it is lost at the ends alone"),
    ),
    terms=terms,
)
