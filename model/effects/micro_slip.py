"""Micro-slip: at the force level of the test part of each interface slips.

Iwan's model with Segalman's power law: the slipping share kappa takes stiffness away and dissipates. Kappa is
stated at p_ref = 160 kPa and falls as 1 / p, for pressure holds; it is that of the test's one force level.

Enters: tangential contact, stiffness times -kappa p_ref / p and loss factor (4 / pi) kappa p_ref / (3 p);
    depends on frequency in the damping. Amplitude itself is not a variable of this linear model: another level
    is another kappa.
Range: kappa from 0 to 0.25.
Does: lowers T1, B1 and B2 by 4 % and T2 by 2 % and adds 1.8 % and 0.8 % damping at low torque; half of it at
    twice the pressure. (Demo stack, nominal strength.)
Mistaken for: pressure_exponent above 1 in frequencies, contact_loss in damping; a second force level tells it.
"""

from __future__ import annotations

import math
from typing import Any

from model.effects.parts import again
from model.elements.equations import Assembly, Term, Theta
from model.stack.effect import PRESSURE_REFERENCE, Effect, Parameter


def _slip(t: Theta) -> Any:
    return t["slip_share"] * PRESSURE_REFERENCE / t["pressure"]


def _change(t: Theta) -> Any:
    return -_slip(t)


def _loss(t: Theta) -> Any:
    loss = 4.0 / (3.0 * math.pi)  # energy lost in a cycle over 2 pi times the stored, for small slip
    return loss * _slip(t) / t["omega"]


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return what the tangential contact loses, and what it dissipates."""
    return (
        again(assembly, "tangential contact", "micro_slip", _change),
        again(assembly, "tangential contact", "micro_slip damping", _loss, target="C"),
    )


EFFECT = Effect(
    name="micro_slip",
    label="micro-slip of the interfaces",
    family="amplitude",
    summary="Part of each interface slips at the force of the test",
    description=__doc__,
    parameters=(
        Parameter(
            name="slip_share",
            unit="1",
            nominal=0.08,
            lower=0.0,
            upper=0.25,
            source="Segalman 2005: micro-slip up to a quarter of the macro-slip stiffness",
        ),
    ),
    terms=terms,
    frequency_dependent=True,
)
