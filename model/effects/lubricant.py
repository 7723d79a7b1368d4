"""Lubricant: a viscous film between the laminas takes energy whatever the pressure.

Enters: damping matrix of the tangential contact with a viscosity c per spacing, G'' = c omega; affine.
Range: 0 to 5e4 Pa s of effective viscosity over the pitch (film of oil of 0.1 Pa s, a thousandth of the pitch
    thick).
Does: adds damping that grows with frequency, 0.26 % to T1 and 0.44 % to T2, and by a third to a half less at
    twice the pressure. Frequencies stay. (Demo stack, nominal strength.)
Mistaken for: steel_loss, contact_loss; at one torque partly d_f.
"""

from __future__ import annotations

import numpy as np

from model.contact.contact import tangential_krons
from model.elements.equations import Assembly, Monomial, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return a film of 1 Pa s on all interfaces."""
    stack = assembly.stack
    krons = tangential_krons(assembly.plan, stack.spacing, np.ones(stack.n_lamina - 1))
    return (Term(name="lubricant", target="C", factor=Monomial(exponent={"film_viscosity": 1}), krons=krons),)


EFFECT = Effect(
    name="lubricant",
    label="viscous film between the laminas",
    family="treatments",
    summary="A viscous film between the laminas",
    description=__doc__,
    parameters=(
        Parameter(
            name="film_viscosity",
            unit="Pa s",
            nominal=800.0,
            lower=0.0,
            upper=10000.0,
            source="oil of 0.1 Pa s in gaps of 1e-4 to 1e-5 of the pitch",
        ),
    ),
    terms=terms,
)
