"""Steel loss: the sheets and their coating dissipate in stretching and bending.

Enters: damping matrix eta K_lamina / omega; affine in eta, depends on frequency.
Range: 1e-4 for steel up to 0.02 for coated sheet.
Does: adds 0.09 % damping to T2 and about 0.01 % to the others, whose energy is in the contact. Frequencies
    stay. (Demo stack, nominal strength.)
Mistaken for: contact_loss.
"""

from __future__ import annotations

from typing import Any

from model.effects.parts import again
from model.elements.equations import Assembly, Term, Theta
from model.stack.effect import Effect, Parameter


def _loss(t: Theta) -> Any:
    return t["steel_eta"] / t["omega"]


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return what dissipates."""
    return (again(assembly, "laminas", "steel_loss", _loss, target="C"),)


EFFECT = Effect(
    name="steel_loss",
    label="material loss of the steel",
    family="damping",
    summary="Steel loss",
    description=__doc__,
    parameters=(
        Parameter(
            name="steel_eta",
            unit="1",
            nominal=0.003,
            lower=0.0,
            upper=0.02,
            source="1e-4 for steel up to 0.02 for coated sheet",
        ),
    ),
    terms=terms,
    frequency_dependent=True,
)
