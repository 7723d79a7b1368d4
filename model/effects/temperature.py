"""Temperature: warm steel is softer.

Enters: stiffness of the laminas, times -2.5e-4 per kelvin; affine.
Range: -15 to 40 K against the temperature at which E was measured.
Does: lowers T2 by 0.1 % and the others by 0.02 % or less, for contact sets these modes. (Demo stack, nominal
    strength.)
Mistaken for: Young's modulus itself: it is one with that nuisance.
"""

from __future__ import annotations

from typing import Any

from model.effects.parts import again
from model.elements.equations import Assembly, Term, Theta
from model.stack.effect import Effect, Parameter


def _change(t: Theta) -> Any:
    per_kelvin = -2.5e-4  # of Young's modulus of ferritic steel about room temperature
    return per_kelvin * t["warming"]


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return what the laminas' stiffness loses."""
    return (again(assembly, "laminas", "temperature", _change),)


EFFECT = Effect(
    name="temperature",
    label="temperature of the steel",
    stated="Young's modulus",
    family="steel",
    summary="Warm steel is softer",
    description=__doc__,
    parameters=(
        Parameter(
            name="warming",
            unit="K",
            nominal=15.0,
            lower=-15.0,
            upper=40.0,
            source="laboratories in winter and summer, shaker heat",
        ),
    ),
    terms=terms,
)
