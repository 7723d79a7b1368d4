"""Suspension stiffness: the cords or foam on which the free stack rests.

Four soft springs under the bottom face, at 0.22 of the length from the ends.

Enters: springs to the ground, spread over the height, on w (k each) and a tenth of it on u and v; affine.
Range: 0 to 2e6 N/m each: bungee cords of 1e3 up to stiff rubber feet.
Does: raises the rigid-body modes from 0, T1 by 0.6 %, B1 by 0.3 % and B2 by 0.1 % at low torque, half of it
    at twice the pressure. (Demo stack, nominal strength.)
Mistaken for: stinger_stiffness, a higher G_f in the lowest modes.
"""

from __future__ import annotations

import numpy as np

from model.effects.parts import every_lamina, square
from model.elements.equations import Assembly, Monomial, Term
from model.elements.mesh import FIELDS
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return four springs of 1 N/m under the stack."""
    sideways = 0.1
    stack = assembly.stack
    x, y = 0.28 * stack.length, 0.3 * stack.width
    feet = np.array([[-x, -y], [-x, y], [x, -y], [x, y]])
    strength = {"u": sideways, "v": sideways, "w": 1.0}
    krons = tuple(
        square(field, assembly.plan.point_rows(field, feet), every_lamina(stack), strength[field]) for field in FIELDS
    )
    factor = Monomial(exponent={"suspension_stiffness": 1})
    return (Term(name="suspension", target="K", factor=factor, krons=krons),)


EFFECT = Effect(
    name="suspension",
    label="stiffness of the suspension",
    family="boundary",
    summary="Stiffness of cords or feet under the stack",
    description=__doc__,
    parameters=(
        Parameter(
            name="suspension_stiffness",
            unit="N/m",
            nominal=200000.0,
            lower=0.0,
            upper=2000000.0,
            source="bungee cords 1e3, rubber feet 1e5 to 2e6 N/m",
        ),
    ),
    terms=terms,
    grounded=True,
)
