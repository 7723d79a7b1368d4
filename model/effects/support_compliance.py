"""Compliance of a clamped edge: what holds an edge gives way.

A support that the stack file calls clamped, pinned or elastic has a compliance in series with its stiffness.

Enters: stiffness of the supports, k / (1 + c k / k_ref) in place of k, where k_ref is the bending stiffness of
    a lamina over one element of its mesh; not affine in c, but one matrix with a rational factor.
Range: c from 0 (as the stack file says) to 1.
Does: lowers all modes of a held stack, eight laminas clamped at one end by 0.04 to 0.24 % at the nominal
    compliance and by 15 to 23 % at the upper one, no mode much more than another.
Mistaken for: a lower Young's modulus, temperature.
"""

from __future__ import annotations

from typing import Any

from model.elements.equations import Assembly, Formula, Term, Theta
from model.stack.effect import Effect, Parameter
from model.stack.errors import EffectError

_HELD = (
    1e5  # a held motion's stiffness relative to a lamina's over one element, as in `model.elements.support`
)


def _softening(t: Theta) -> Any:
    return 1.0 / (1.0 + _HELD * t["support_compliance"]) - 1.0


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return what the supports' stiffness loses."""
    supports = [term for term in assembly.terms if term.name.startswith("support ")]
    if not supports:
        message = "support_compliance: the stack has no supports; add [[supports]] to its file"
        raise EffectError(message)
    krons = tuple(kron for term in supports for kron in term.krons)
    return (Term(name="support_compliance", target="K", factor=Formula(_softening), krons=krons),)


EFFECT = Effect(
    name="support_compliance",
    label="compliance of a held edge",
    family="boundary",
    summary="A held edge gives way",
    description=__doc__,
    parameters=(
        Parameter(
            name="support_compliance",
            unit="1",
            nominal=0.001,
            lower=0.0,
            upper=1.0,
            source="from a rigid vice to rubber jaws; relative to a lamina over one element",
        ),
    ),
    terms=terms,
    grounded=True,
)
