"""Accelerometer mass, fixed: a reference accelerometer that stays on the stack for all runs.

It sits at the corner opposite to the shaker, on top.

Enters: mass matrix at one point of the plan, spread over the height, all directions; affine.
Range: 0 to 0.05 kg: miniature accelerometers weigh 1 to 50 g with cable and mounting.
Does: lowers T1 by 0.3 % and T2 by 0.4 to 0.5 %, B1 and B2 by 0.1 to 0.2 %: a corner moves most in torsion.
    The same between torques. (Demo stack, nominal strength.)
Mistaken for: noise; stinger_mass, which sits elsewhere; a small change of density.
"""

from __future__ import annotations

import numpy as np

from model.effects.parts import known_or_usual_instruments, point_mass
from model.elements.equations import Assembly, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return a mass of 1 kg at the corner opposite to the shaker."""
    x, y, _ = known_or_usual_instruments(assembly.stack).shaker
    return point_mass(assembly, "accelerometer_fixed", "fixed_sensor_mass", np.array([[-x, -y]]))


EFFECT = Effect(
    name="accelerometer_fixed",
    label="mass of a fixed accelerometer",
    family="inertia",
    summary="Mass of an accelerometer that stays in place",
    description=__doc__,
    parameters=(
        Parameter(
            name="fixed_sensor_mass",
            unit="kg",
            nominal=0.02,
            lower=0.0,
            upper=0.05,
            source="data sheets of general-purpose accelerometers with mounting",
        ),
    ),
    terms=terms,
)
