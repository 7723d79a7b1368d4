"""Hysteretic contact loss: friction takes the same energy per cycle at all frequencies.

Enters: damping matrix eta K_contact / omega of the tangential contact; affine in eta, depends on frequency.
Range: loss factors of 0.005 to 0.08 of dry joints.
Does: adds 0.5 % damping to T1, B1 and B2 and 0.2 % to T2, the same at both torques. Frequencies stay. (Demo
    stack, nominal strength.)
Mistaken for: steel_loss, lubricant.
"""

from __future__ import annotations

from typing import Any

from model.effects.parts import again
from model.elements.equations import Assembly, Term, Theta
from model.stack.effect import Effect, Parameter


def _loss(t: Theta) -> Any:
    return t["contact_eta"] / t["omega"]


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return what dissipates."""
    return (again(assembly, "tangential contact", "contact_loss", _loss, target="C"),)


EFFECT = Effect(
    name="contact_loss",
    label="hysteretic contact loss",
    family="damping",
    summary="Hysteretic contact loss",
    description=__doc__,
    parameters=(
        Parameter(
            name="contact_eta",
            unit="1",
            nominal=0.01,
            lower=0.0,
            upper=0.08,
            source="loss factors of 0.005 to 0.08 of dry joints",
        ),
    ),
    terms=terms,
    frequency_dependent=True,
)
