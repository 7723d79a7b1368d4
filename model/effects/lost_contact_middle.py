"""Lost contact in the middle: laminas do not touch in the middle of the stack.

Enters: pressure p (1 + a f(x, y)), f a bell of standard deviation w about x = 0, turned down, less its mean. Stiffness
    is affine in a, damping a polynomial of it. Between bells of six widths the field is interpolated (quadratic splines
    over log w), within 0.4 % of one bell, 2 % near the ends.
Range: a from 0 to 0.95 of the pressure lost in the middle, w from a seventeenth to a third of the length.
Does: lowers B2 by 12 %, B1 by 4 % and T1 by 3 %, and leaves T2 or raises it by 1 %. Nearly the same between
    torques. (Demo stack, nominal strength.)
Mistaken for: clamp_width, waviness, contact_direction.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from lamella_shared import Reals
from model.effects.parts import Size, pressure_change
from model.elements.equations import Assembly, Term
from model.stack.effect import Effect, Parameter

_WIDTH = Size(name="middle_width", usual=1.0 / 6.0, octaves=(-1.5, 1.0), n=6)


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the change of the pressure field."""

    def bell(x: Reals, y: Reals, width: float) -> Reals:
        return np.asarray(-np.exp(-0.5 * (x / (width * assembly.stack.length)) ** 2) + 0.0 * y)

    return tuple(
        term
        for i, (width, share) in enumerate(_WIDTH.fields)
        for term in pressure_change(
            assembly, f"lost_contact_middle {i + 1}", "middle_loss", partial(bell, width=width), share
        )
    )


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
        _WIDTH.parameter("w over the length: from a quarter of the distance of four clamps to all of it"),
    ),
    terms=terms,
)
