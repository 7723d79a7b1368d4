"""Support loss: cords, foam, cables and the shaker's coil take energy at places.

Dashpots at the four suspension points.

Enters: damping matrix on w at four points of the plan, spread over the height; affine.
Range: 0 to 500 N s/m each.
Does: adds 0.25 % damping to T1, 0.13 to B1, 0.06 to B2 and 0.01 to T2 at low torque, less at higher
    frequency. Frequencies stay. (Demo stack, nominal strength.)
Mistaken for: air_damping.
"""

from __future__ import annotations

import numpy as np

from model.effects.parts import every_lamina, square
from model.elements.equations import Assembly, Monomial, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return four dashpots of 1 N s/m under the stack."""
    stack = assembly.stack
    x, y = 0.28 * stack.length, 0.3 * stack.width
    rows = assembly.plan.point_rows("w", np.array([[-x, -y], [-x, y], [x, -y], [x, y]]))
    krons = (square("w", rows, every_lamina(stack)),)
    return (Term(name="support_loss", target="C", factor=Monomial(exponent={"dashpot": 1}), krons=krons),)


EFFECT = Effect(
    name="support_loss",
    label="damping at the suspension",
    family="damping",
    summary="Dashpots at the suspension",
    description=__doc__,
    parameters=(
        Parameter(
            name="dashpot",
            unit="N s/m",
            nominal=60.0,
            lower=0.0,
            upper=500.0,
            source="foam and cords under a stack of some 15 kg",
        ),
    ),
    terms=terms,
    grounded=True,
)
