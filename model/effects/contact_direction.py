"""Direction-dependent contact: laminas slip more easily along the rolling marks than across.

G_yz = r G_xz: grinding and rolling leave grooves along x.

Enters: tangential contact stiffness and damping in y, times (r - 1) under
    every pressure field and power law (see `contact_change`); affine.
Range: r from 0.4 to 2.5.
Does: r = 0.75 lowers T2 by 3 % at low and 1 % at high torque and T1 by 0.4 %, and leaves bending, which
    shears x-z only. (Demo stack, nominal strength.)
Mistaken for: clamp_inertia, lost contact at the edges, waviness.
"""

from __future__ import annotations

from typing import Any

from model.contact.contact import contact_fields
from model.effects.parts import again, contact_law
from model.elements.equations import Assembly, Term, Theta
from model.stack.effect import Effect, Parameter


def _change(t: Theta) -> Any:
    return (t["G_yz_ratio"] - 1.0) * contact_law(t)


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return what the tangential contact in y alone gains."""
    field = contact_fields(assembly.stack, assembly.plan)
    stiffness, damping = (field[name].tangential(axes="y") for name in ("pressure", "pressure squared"))
    return (
        again(assembly, "tangential contact", "contact_direction", _change, krons=stiffness),
        again(assembly, "tangential contact damping", "contact_direction damping", _change, krons=damping),
    )


EFFECT = Effect(
    name="contact_direction",
    label="direction-dependent contact stiffness",
    family="contact law",
    summary="Tangential contact stiffness differs between x and y",
    description=__doc__,
    parameters=(
        Parameter(
            name="G_yz_ratio",
            unit="1",
            nominal=0.75,
            lower=0.4,
            upper=2.5,
            neutral=1.0,
            scale="log",
            source="friction along and across rolling marks",
        ),
    ),
    terms=terms,
)
