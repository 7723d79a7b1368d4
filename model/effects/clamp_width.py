"""Pressure under the clamps: the pressure is high near the clamps and low between them.

Enters: pressure p (1 + a f(x, y)), f a bell of width height / 2 plus half of the footprint about each clamp,
    less its mean. Stiffness is affine in a, damping a polynomial of it.
Range: a from 0 (even) to 0.95 (hardly any pressure far from the clamps).
Does: lowers T2 by 6 % at low and 4 % at high torque and raises T1, B1 and B2 by 2 %: pressure moves from the
    ends to the clamps, which stand near the middle. (Demo stack, nominal strength.)
Mistaken for: lost_contact_ends, a lower G_f.
"""

from __future__ import annotations

import numpy as np

from lamella_shared import Reals
from model.effects.parts import clamps_of, pressure_change
from model.elements.equations import Assembly, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the change of the pressure field."""
    stack = assembly.stack
    clamps = clamps_of(assembly, "clamp_width")

    def shape(x: Reals, y: Reals) -> Reals:
        bells = [
            clamp.share
            * np.exp(
                -0.5 * ((x - clamp.x) / (stack.height / 2.0 + clamp.footprint[0] / 2.0)) ** 2
                - 0.5 * ((y - clamp.y) / (stack.height / 2.0 + clamp.footprint[1] / 2.0)) ** 2
            )
            for clamp in clamps
        ]
        return np.asarray(np.sum(bells, axis=0))

    return pressure_change(assembly, "clamp_width", "pressure_concentration", shape)


EFFECT = Effect(
    name="clamp_width",
    label="pressure concentration under the clamps",
    family="pressure field",
    summary="Pressure under the clamps",
    description=__doc__,
    parameters=(
        Parameter(
            name="pressure_concentration",
            unit="1",
            nominal=0.5,
            lower=0.0,
            upper=0.95,
            source="a from 0 (even) to 0.95 (hardly any pressure far from the clamps)",
        ),
    ),
    terms=terms,
)
