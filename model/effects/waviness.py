"""Waviness: the sheets are wavy along x, so pressure is high on crests and low in troughs.

Enters: pressure p (1 + a f(x, y)), f a cosine of four waves over the length. Stiffness is affine in a, damping
    a polynomial of it.
Range: a from 0 to 0.95; IEC 60404-9 allows wave factors of 2 to 3 %, far above the compression of the stack.
Does: lowers B1 by 9 %, B2 by 7 %, T1 by 4 % and T2 by 3 %. The same between torques. (Demo stack, nominal
    strength.)
Mistaken for: a lower G_f, lost_contact_middle.
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
        return np.asarray(np.cos(8.0 * np.pi * x / stack.length) + 0.0 * y)

    return pressure_change(assembly, "waviness", "wave_amplitude", shape)


EFFECT = Effect(
    name="waviness",
    label="waviness of the sheets",
    family="pressure field",
    summary="Waviness",
    description=__doc__,
    parameters=(
        Parameter(
            name="wave_amplitude",
            unit="1",
            nominal=0.5,
            lower=0.0,
            upper=0.95,
            source="a from 0 to 0.95; IEC 60404-9 allows wave factors of 2 to 3 %, above the stack's compression",
        ),
    ),
    terms=terms,
)
