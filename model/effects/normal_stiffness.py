"""Normal contact stiffness: the compression curve's tangent is not what the base model says.

Enters: normal contact stiffness and damping, times (r - 1); affine.
Range: r from 0.2 to 5: compression curves of steel stacks differ by this between coatings.
Does: hardly anything to the four modes: at most 0.07 %, T2 at low torque. (Demo stack, nominal strength.)
Mistaken for: clamp_rods, contact_direction at small changes.
"""

from __future__ import annotations

from typing import Any

from model.effects.parts import again
from model.elements.equations import Assembly, Term, Theta
from model.stack.effect import Effect, Parameter


def _change(t: Theta) -> Any:
    return t["normal_ratio"] - 1.0


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return what the normal contact gains."""
    return (
        again(assembly, "normal contact", "normal_stiffness", _change),
        again(assembly, "normal contact damping", "normal_stiffness damping", _change),
    )


EFFECT = Effect(
    name="normal_stiffness",
    label="normal contact stiffness",
    family="contact law",
    summary="Normal contact is stiffer or softer than the curve says",
    description=__doc__,
    parameters=(
        Parameter(
            name="normal_ratio",
            unit="1",
            nominal=0.5,
            lower=0.2,
            upper=5.0,
            neutral=1.0,
            scale="log",
            source="spread of compression curves between coatings",
        ),
    ),
    terms=terms,
)
