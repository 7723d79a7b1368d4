"""Adhesive at the edges: glue that crept between the laminas along both long edges.

Enters: shear modulus times thickness share in strips of a tenth of the width along both edges; affine.
Range: 0 to 5e8 Pa of effective modulus: epoxy of 1 GPa filling up to half of the strip.
Does: raises T1 by 8 %, B1 and B2 by 4 % and T2 by 2 % at low torque, half of it at twice the pressure. (Demo
    stack, nominal strength.)
Mistaken for: edge_pressure, weld_seam, contact_offset.
"""

from __future__ import annotations

import numpy as np

from model.contact.contact import tangential_krons
from model.elements.equations import Assembly, Monomial, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return a modulus of 1 Pa that fades from both edges over a tenth of the width."""
    strip = 0.1
    stack = assembly.stack
    y = assembly.plan.quadrature_points[1]
    inward = (stack.width / 2.0 - np.abs(y)) / (strip * stack.width)
    krons = tangential_krons(assembly.plan, stack.spacing, np.ones(stack.n_lamina - 1), np.exp(-inward))
    factor = Monomial(exponent={"adhesive_modulus": 1})
    return (Term(name="adhesive_edges", target="K", factor=factor, krons=krons),)


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
    ),
    terms=terms,
)
