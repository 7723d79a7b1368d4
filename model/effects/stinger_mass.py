"""Stinger and force-cell mass: what hangs on the stack behind the force sensor's crystal.

Half of the force cell, its stud and the end of the stinger move with the driving point.

Enters: mass matrix at the shaker's point of the plan, spread over the height, all directions; affine.
Range: 0 to 0.15 kg: force cells of 20 to 60 g, adaptor and half of a stinger.
Does: lowers T2 by 1.1 to 1.4 %, T1 by 0.8 %, B1 and B2 by 0.3 to 0.4 %: a corner moves most in torsion.
    Spoils the driving point's antiresonances. (Demo stack, nominal strength.)
Mistaken for: accelerometer_fixed, stinger_stiffness (opposite sign), clamp_mass.
"""

from __future__ import annotations

import numpy as np

from model.effects.parts import known_or_usual_instruments, point_mass
from model.elements.equations import Assembly, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return a mass of 1 kg at the shaker's point."""
    x, y, _ = known_or_usual_instruments(assembly.stack).shaker
    return point_mass(assembly, "stinger_mass", "stinger_moving_mass", np.array([[x, y]]))


EFFECT = Effect(
    name="stinger_mass",
    label="moving mass at the shaker",
    family="inertia",
    summary="Mass of force cell and stinger at the driving point",
    description=__doc__,
    parameters=(
        Parameter(
            name="stinger_moving_mass",
            unit="kg",
            nominal=0.05,
            lower=0.0,
            upper=0.15,
            source="data sheets of force cells; a steel stinger of 2 mm weighs 25 g per metre",
        ),
    ),
    terms=terms,
)
