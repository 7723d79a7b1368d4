"""Soft interlayers: two interfaces, at a third and two thirds of the height, carry less shear.

Silicon or paper that somebody put there, or coating that came off.

Enters: tangential contact of these interfaces, times -s; affine.
Range: s from 0 to 0.995: left over is 1 - s of the contact.
Does: lowers B1 by 3 %, B2 by 3 %, T1 by 2 % and T2 by 1 %, nearly alike at both torques. (Demo stack, nominal
    strength.)
Mistaken for: a lower G_f; often not visible.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from model.contact import contact_fields
from model.effect import Effect, Parameter
from model.system import Assembly, Formula, Term, Theta


def _stiffness(t: Theta) -> Any:
    return -t["G_f"] * t["pressure"] * t["interlayer_loss"]


def _damping(t: Theta) -> Any:
    return -t["d_f"] * t["G_f"] * t["pressure"] ** 2 * t["interlayer_loss"]


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the contact of the two interfaces."""
    field = contact_fields(assembly.stack, assembly.plan)
    n = assembly.stack.n_lamina - 1
    share = np.zeros(n)
    share[[n // 3, (2 * n) // 3]] = 1.0
    return (
        Term(
            name="soft_interlayers",
            target="K",
            factor=Formula(_stiffness),
            krons=field["pressure"].over_interfaces(share).tangential(),
        ),
        Term(
            name="soft_interlayers damping",
            target="C",
            factor=Formula(_damping),
            krons=field["pressure squared"].over_interfaces(share).tangential(),
        ),
    )


EFFECT = Effect(
    name="soft_interlayers",
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
