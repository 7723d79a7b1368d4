"""Viscoelastic contact: coating between the laminas stiffens with frequency.

A fractional (spring-pot) law: G(omega) = G_f p (omega / omega_ref)^alpha, omega_ref = 2 pi 500 Hz, with the
loss factor tan(pi alpha / 2) that belongs to it.

Enters: tangential contact stiffness and damping; depends on frequency, not affine in alpha: one matrix with an
    exact factor.
Range: alpha from 0 to 0.15.
Does: lowers T1 and B1 by 0.8 to 1.0 % and raises T2 by 0.4 % at low torque, as they lie below and above 500
    Hz; adds 2.2 % damping, 1 % to T2. (Demo stack, nominal strength.)
Mistaken for: contact_loss in damping, normal_stiffness in frequencies.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from model.effects.parts import again
from model.elements.equations import Assembly, Term, Theta
from model.stack.effect import OMEGA_REFERENCE, Effect, Parameter


def _growth(t: Theta) -> Any:
    return np.exp(t["fraction"] * np.log(t["omega"] / OMEGA_REFERENCE))


def _change(t: Theta) -> Any:
    return _growth(t) - 1.0


def _loss(t: Theta) -> Any:
    return _growth(t) * np.tan(np.pi * t["fraction"] / 2.0) / t["omega"]


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return what the tangential contact gains, and what it dissipates."""
    return (
        again(assembly, "tangential contact", "viscoelastic_contact", _change),
        again(assembly, "tangential contact", "viscoelastic_contact damping", _loss, target="C"),
    )


EFFECT = Effect(
    name="viscoelastic_contact",
    label="contact that stiffens with frequency",
    family="damping",
    summary="Contact stiffens with frequency",
    description=__doc__,
    parameters=(
        Parameter(
            name="fraction",
            unit="1",
            nominal=0.03,
            lower=0.0,
            upper=0.15,
            source="fractional orders of coatings and varnish in their glassy range",
        ),
    ),
    terms=terms,
    frequency_dependent=True,
)
