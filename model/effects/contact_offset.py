"""Contact offset: shear stiffness that is there without pressure.

G = G_f p + G0: coating, burrs or interlocking hold the laminas together even when nothing presses.

Enters: tangential contact stiffness G0 on all interfaces; affine.
Range: 0 to 1.5e8 Pa, up to about the G_f p of the paper's M1.
Does: raises T1, B1 and B2 by 10 % and T2 by 4 % at low torque, half of that at twice the pressure; one torque
    alone cannot tell it from G_f. (Demo stack, nominal strength.)
Mistaken for: pressure_exponent, clamp_frame; with one torque G_f itself.
"""

from __future__ import annotations

from model.contact.contact import tangential_krons
from model.elements.equations import Assembly, Monomial, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return a shear modulus of 1 Pa on all interfaces that touch."""
    stack = assembly.stack
    krons = tangential_krons(assembly.plan, stack.spacing, stack.touching)
    return (Term(name="contact_offset", target="K", factor=Monomial(exponent={"G0": 1}), krons=krons),)


EFFECT = Effect(
    name="contact_offset",
    label="contact stiffness without pressure",
    family="contact law",
    summary="Shear stiffness without pressure",
    description=__doc__,
    parameters=(
        Parameter(
            name="G0",
            unit="Pa",
            nominal=50000000.0,
            lower=0.0,
            upper=150000000.0,
            source="up to G_f p at M1 of Table 6",
        ),
    ),
    terms=terms,
)
