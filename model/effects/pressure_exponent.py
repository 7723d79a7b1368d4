"""Pressure exponent: contact stiffness grows as p^n instead of p.

G = G_f p_ref (p / p_ref)^n with p_ref = 160 kPa. Rough surfaces that slip on asperities give exponents well
below 1.

Enters: tangential contact stiffness and damping, times (p / p_ref)^(n - 1). Not affine in n: under uniform
    pressure one matrix with an exact factor; under the stated field of pressure the mean's power is taken and the
    field's shape kept; what an effect takes of the pressure follows the power (see `contact_change`).
Range: n from 0.2 to 1.3; 1/3 to 1 for rough and Hertzian contacts (Greenwood and Williamson 1966; Mindlin
    1949).
Does: nothing at p_ref that G_f cannot do; at twice the pressure T1, B1 and B2 are 15 % and T2 7 % lower than
    with n = 1. (Demo stack, nominal strength.)
Mistaken for: with one torque G_f itself; with two contact_offset and clamp_frame; torque error.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from model.effects.parts import again
from model.elements.equations import Assembly, Term, Theta
from model.stack.effect import PRESSURE_REFERENCE, Effect, Parameter


def _change(t: Theta) -> Any:
    return np.exp((t["exponent"] - 1.0) * np.log(t["pressure"] / PRESSURE_REFERENCE)) - 1.0


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return what the power law adds to the proportional one."""
    return (
        again(assembly, "tangential contact", "pressure_exponent", _change),
        again(assembly, "tangential contact damping", "pressure_exponent damping", _change),
    )


EFFECT = Effect(
    name="pressure_exponent",
    label="power law of contact stiffness over pressure",
    family="contact law",
    summary="G grows as p^n",
    description=__doc__,
    parameters=(
        Parameter(
            name="exponent",
            unit="1",
            nominal=0.5,
            lower=0.2,
            upper=1.3,
            neutral=1.0,
            source="Greenwood and Williamson 1966; Mindlin 1949",
        ),
    ),
    terms=terms,
)
