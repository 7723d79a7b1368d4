"""Normal contact stiffness that grows with pressure.

E_z = E_z0 (p / p_ref)^m with p_ref = 160 kPa; the base model's modulus does not change between torques unless a
compression curve says so.

Enters: normal contact stiffness, times (p / p_ref)^m - 1; one matrix with an exact factor.
Range: m from 0 to 1; 1/2 is usual of rough stacks.
Does: nothing at p_ref; at twice the pressure all four modes rise by only 0.01 %. (Demo stack, nominal
    strength.)
Mistaken for: normal_stiffness with one torque, pressure_exponent.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from model.effects.parts import again
from model.elements.equations import Assembly, Term, Theta
from model.stack.effect import PRESSURE_REFERENCE, Effect, Parameter


def _change(t: Theta) -> Any:
    return np.exp(t["normal_exponent"] * np.log(t["pressure"] / PRESSURE_REFERENCE)) - 1.0


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return what the power law adds to the normal contact."""
    return (again(assembly, "normal contact", "normal_exponent", _change),)


EFFECT = Effect(
    name="normal_exponent",
    label="normal contact that stiffens with pressure",
    family="contact law",
    summary="Normal contact stiffness grows with pressure",
    description=__doc__,
    parameters=(
        Parameter(
            name="normal_exponent",
            unit="1",
            nominal=0.5,
            lower=0.0,
            upper=1.0,
            source="E_z of rough stacks grows about as the root of pressure",
        ),
    ),
    terms=terms,
)
