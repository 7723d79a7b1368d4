"""Air and mass-proportional damping: what slows all motion alike.

Enters: damping matrix alpha M of the laminas; affine.
Range: radiation, cables and suspension together.
Does: adds damping in inverse proportion to frequency: 0.16 % to T1, 0.04 % to T2. Frequencies stay. (Demo
    stack, nominal strength.)
Mistaken for: support_loss.
"""

from __future__ import annotations

from typing import Any

from model.effects.parts import again
from model.elements.equations import Assembly, Term, Theta
from model.stack.effect import Effect, Parameter


def _loss(t: Theta) -> Any:
    return t["mass_damping"]


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return what dissipates."""
    return (again(assembly, "lamina mass", "air_damping", _loss, target="C"),)


EFFECT = Effect(
    name="air_damping",
    label="air and mass-proportional damping",
    family="damping",
    summary="Air and mass-proportional damping",
    description=__doc__,
    parameters=(
        Parameter(
            name="mass_damping",
            unit="1/s",
            nominal=6.0,
            lower=0.0,
            upper=40.0,
            source="radiation, cables and suspension together",
        ),
    ),
    terms=terms,
    grounded=True,
)
