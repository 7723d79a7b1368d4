"""Pressure gradient over the height: friction on rods and in the press lets pressure fade downwards.

Enters: pressure p (1 + a (2 k - N) / N) at interface k of N, affine in a; damping a polynomial
    of it.
Range: a from -0.9 to 0.9.
Does: lowers all four modes by 0.2 to 0.5 %: the first order cancels, the second does not. Nearly the same
    between torques. (Demo stack, nominal strength.)
Mistaken for: a lower G_f; often not visible at all.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from model.contact.contact import contact_fields
from model.effects.parts import contact_change
from model.elements.equations import Assembly, Term, Theta
from model.stack.effect import Effect, Parameter


def _change(t: Theta) -> Any:
    return t["height_excess"]


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the change over the interfaces."""
    field = contact_fields(assembly.stack, assembly.plan)
    share = np.linspace(-1.0, 1.0, assembly.stack.n_lamina - 1)
    stiffness = partial(field["pressure"].over_interfaces(share).tangential, 1.0)
    damping = partial(field["pressure squared"].over_interfaces(share).tangential, 1.0)
    squared = partial(field["pressure squared"].over_interfaces(share**2).tangential, 1.0)
    return contact_change(assembly, "height_gradient", _change, stiffness, (damping, squared))


EFFECT = Effect(
    name="height_gradient",
    label="pressure gradient over the height",
    family="pressure field",
    summary="Pressure differs between top and bottom",
    description=__doc__,
    parameters=(
        Parameter(
            name="height_excess",
            unit="1",
            nominal=0.4,
            lower=-0.9,
            upper=0.9,
            source="friction along rods of stamped stacks",
        ),
    ),
    terms=terms,
)
