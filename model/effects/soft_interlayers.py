"""Soft interlayers: two interfaces, at a third and two thirds of the height, carry less shear.

Silicon or paper that somebody put there, or coating that came off.

Enters: tangential contact of these interfaces, times -s; affine.
Range: s from 0 to 0.995: left over is 1 - s of the contact.
Does: lowers B1 by 3 %, B2 by 3 %, T1 by 2 % and T2 by 1 %, nearly alike at both torques. (Demo stack, nominal
    strength.)
Mistaken for: a lower G_f; often not visible.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from model.contact.contact import contact_fields
from model.effects.parts import under_laws
from model.elements.equations import Assembly, Term, Theta
from model.stack.effect import Effect, Parameter
from model.stack.errors import EffectError


def _change(t: Theta) -> Any:
    return -t["interlayer_loss"]


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return what the contact of the two interfaces loses."""
    n = assembly.stack.n_lamina - 1
    if n < 1:
        raise EffectError("soft_interlayers: the stack has one lamina, and no interface")
    field = contact_fields(assembly.stack, assembly.plan)
    share = np.zeros(n)
    share[[n // 3, (2 * n) // 3]] = 1.0
    stiffness = partial(field["pressure"].over_interfaces(share).tangential, 1.0)
    damping = partial(field["pressure squared"].over_interfaces(share).tangential, 1.0)
    return (
        *under_laws(assembly, "tangential contact", "soft_interlayers", _change, stiffness),
        *under_laws(assembly, "tangential contact damping", "soft_interlayers damping", _change, damping),
    )


EFFECT = Effect(
    name="soft_interlayers",
    label="soft interlayers",
    family="treatments",
    summary="Two interfaces carry less shear",
    description=__doc__,
    parameters=(
        Parameter(
            name="interlayer_loss",
            unit="1",
            nominal=0.9,
            lower=0.0,
            upper=0.995,
            source="silicon sheets of 2 mm of Table 1 have about 1e-3 of the contact's stiffness",
        ),
    ),
    terms=terms,
)
