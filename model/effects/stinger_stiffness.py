"""Stinger stiffness: the stinger holds the driving point sideways and against turning.

The force cell measures the axial force, so the stinger's axial stiffness does not enter the FRFs; its bending
does, as forces that nobody measures.

Enters: springs to the ground on u, v (k) and on the slopes (k l**2/3, l = 50 mm) at the shaker's point of the
    plan, spread over the height; affine.
Range: 0 to 6e5 N/m: 12 E I / l**3 of a steel stinger of 2 to 5 mm over 50 to 150 mm, screwed in at both ends.
Does: raises T1 by 0.16 % at low torque and half of it at twice the pressure; the others by 0.01 % or less.
    Puts low suspension modes in. (Demo stack, nominal strength.)
Mistaken for: suspension, stinger_mass (opposite sign).
"""

from __future__ import annotations

import numpy as np

from model.effects.parts import every_lamina, known_or_usual_instruments, mean_over, square
from model.elements.equations import Assembly, Monomial, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return springs of 1 N/m at the shaker's point."""
    length = 0.05
    pad = (0.03, 0.03)  # a thin lamina alone would twist under the stud
    x, y, _ = known_or_usual_instruments(assembly.stack).shaker
    at, point, row = every_lamina(assembly.stack), np.array([[x, y]]), assembly.plan.point_rows
    krons = (
        square("u", row("u", point), at),
        square("v", row("v", point), at),
        *(square("w", mean_over(assembly, "w", (x, y), pad, slope), at, length**2 / 3.0) for slope in ("x", "y")),
    )
    factor = Monomial(exponent={"stinger_lateral": 1})
    return (Term(name="stinger_stiffness", target="K", factor=factor, krons=krons),)


EFFECT = Effect(
    name="stinger_stiffness",
    label="bending stiffness of the stinger",
    family="boundary",
    summary="Bending stiffness of the stinger at the driving point",
    description=__doc__,
    parameters=(
        Parameter(
            name="stinger_lateral",
            unit="N/m",
            nominal=30000.0,
            lower=0.0,
            upper=600000.0,
            source="12 E I / l**3 of a steel stinger of 2 to 5 mm over 50 to 150 mm, screwed in at both ends",
        ),
    ),
    terms=terms,
    grounded=True,
)
