"""Slip of the interfaces: contact that gets softer and loses more as the amplitude grows.

Iwan's model with Segalman's power law of slip limits, in proportion to the local pressure (`model.contact.contact`).
At a shear strain of 1e-5 a cycle finds the contact softer by the share s; at another one by s (strain / 1e-5)^(1 +
chi), until everything slides. A diagnosis uses the strain that each mode has at each force level. Without amplitudes,
as here, all modes have a strain of 1e-5.

Enters: tangential contact, stiffness times -s and a loss factor that belongs to it; depends on frequency in the
    damping.
Range: s from 0 to 0.4, chi from -0.9 to -0.1.
Does: lowers T1, B1 and B2 by 5 % and T2 by 2 % and adds 1.3 % damping, 0.6 % to T2, at a strain of 1e-5. (Demo
    stack, nominal strength.)
Mistaken for: at one force level a softer contact and contact_loss; two levels tell it from all that is linear.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from model.contact.contact import SlipLaw
from model.effects.parts import again
from model.elements.equations import Assembly, Term, Theta
from model.stack.effect import Effect, Parameter

STRAIN = 1e-5
"""Shear strain amplitude at which the effect has its stated strength."""


def _change(t: Theta) -> Any:
    return -t["slip_softening"] + 0.0 * t["slip_exponent"]


def _loss(t: Theta) -> Any:
    n = t["slip_exponent"] + 2.0
    gamma = np.exp(scipy.special.loggamma(n + 1.0) - scipy.special.loggamma(n + 0.5))
    ratio = (n - 1.0) * gamma / (np.sqrt(np.pi) * n)  # `SlipLaw.loss` over `SlipLaw.softening` below sliding
    return ratio * t["slip_softening"] / t["omega"]


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return what the tangential contact loses, and what it dissipates."""
    return (
        again(assembly, "tangential contact", "contact_slip", _change),
        again(assembly, "tangential contact", "contact_slip damping", _loss, target="C"),
    )


def over_strain(t: Theta, strain: Any) -> tuple[Any, Any]:
    """Return by which share the contact is softer at strain amplitudes, and its loss factor there."""
    if t["slip_softening"] <= 0.0:
        return np.zeros_like(strain), np.zeros_like(strain)
    law = SlipLaw(friction=1.0, exponent=t["slip_exponent"])
    x = strain / STRAIN * law.reach(t["slip_softening"])
    return law.softening(x), law.loss(x)


EFFECT = Effect(
    name="contact_slip",
    label="interfaces that slip as the force grows",
    family="amplitude",
    summary="Interfaces slip as the force grows",
    description=__doc__,
    parameters=(
        Parameter(
            name="slip_softening",
            unit="1",
            nominal=0.1,
            lower=0.0,
            upper=0.4,
            source="Segalman 2005: a friction of 0.2 makes 0.11 of it",
        ),
        Parameter(
            name="slip_exponent",
            unit="1",
            nominal=-0.5,
            lower=-0.9,
            upper=-0.1,
            neutral=-0.5,
            source="Segalman 2005: loss of a cycle grows with the force to the power 2 to 3, 3 + chi",
        ),
    ),
    terms=terms,
    frequency_dependent=True,
    over_strain=over_strain,
)
