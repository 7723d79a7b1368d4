"""Wedge in a gap: a thin wedge under one end holds the laminas there together.

Enters: shear modulus over all interfaces in a bell of a tenth of the length at the highest x; affine.
Range: 0 to 2e8 Pa, up to the modulus of the pressed contact; wood, plastic or shim steel.
Does: on the demo stack raises T1 by 0.8 %, T2 0.7, B2 0.5 and B1 0.4; half of that at twice the pressure.
Mistaken for: lost_contact_ends with the opposite sign, adhesive_edges.
"""

import numpy as np

from model import Effect, Monomial, Parameter, Term
from model.contact.contact import tangential_krons


def terms(assembly):
    """Return a shear modulus of 1 Pa at the end; the factor of the term is the parameter."""
    stack, (x, _) = assembly.stack, assembly.plan.quadrature_points
    at_the_end = np.exp(-0.5 * ((x - stack.length / 2.0) / (stack.length / 10.0)) ** 2)
    krons = tangential_krons(assembly.plan, stack.spacing, np.ones(stack.n_lamina - 1), at_the_end)
    return (Term(name="gap_spring", target="K", factor=Monomial(exponent={"wedge_modulus": 1}), krons=krons),)


WEDGE = Parameter(
    name="wedge_modulus", unit="Pa", nominal=5e7, lower=0.0, upper=2e8, source="wood to shim steel"
)  # fmt: skip
EFFECT = Effect(
    name="gap_spring", label="wedge in a gap", family="treatments",
    summary="A wedge holds the laminas at one end", description=__doc__,
    parameters=(WEDGE,), terms=terms,
)  # fmt: skip
