"""Adhesive at the edges: glue that crept between the laminas along both long edges.

Enters: shear modulus times thickness share that fades from both edges over a strip; affine in the modulus. Strips of
    four widths are interpolated (quadratic splines).
Range: 0 to 5e8 Pa of effective modulus: epoxy of 1 GPa filling up to half of the strip; strips of a fortieth to a
    fifth of the width.
Does: raises T1 by 8 %, B1 and B2 by 4 % and T2 by 2 % at low torque, half of it at twice the pressure. (Demo
    stack, nominal strength.)
Mistaken for: edge_pressure, weld_seam, contact_offset.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from model.contact.contact import tangential_krons
from model.effects.parts import Size
from model.elements.equations import Assembly, Formula, Term, Theta
from model.stack.effect import Effect, Parameter

_STRIP = Size(name="adhesive_strip", usual=0.1, octaves=(-2.0, 1.0), n=4)


def _glued(t: Theta, share: Any) -> Any:
    return t["adhesive_modulus"] * share(t)


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return a modulus of 1 Pa that fades from both edges over strips of some widths."""
    stack, y = assembly.stack, assembly.plan.quadrature_points[1]
    inward = (stack.width / 2.0 - np.abs(y)) / stack.width
    return tuple(
        Term(
            name=f"adhesive_edges {i + 1}",
            target="K",
            factor=Formula(partial(_glued, share=share)),
            krons=tangential_krons(assembly.plan, stack.spacing, np.ones(stack.n_lamina - 1), np.exp(-inward / strip)),
        )
        for i, (strip, share) in enumerate(_STRIP.fields)
    )


EFFECT = Effect(
    name="adhesive_edges",
    label="glue along the long edges",
    family="treatments",
    summary="Glue between the laminas along the long edges",
    description=__doc__,
    parameters=(
        Parameter(
            name="adhesive_modulus",
            unit="Pa",
            nominal=100000000.0,
            lower=0.0,
            upper=500000000.0,
            source="epoxy with a shear modulus of 1 GPa that fills part of the strip",
        ),
        _STRIP.parameter("width of the strip over that of the stack, as far as glue creeps"),
    ),
    terms=terms,
)
