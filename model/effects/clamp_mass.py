"""Clamp mass: more (or less) mass under each clamp than the base model has.

Effective mass of bolts, nuts and bars that moves with the footprint of each clamp, spread over the height as
the clamp's own mass is; all clamps get the same.

Enters: mass matrix, for u, v and w of each clamp's footprint; affine.
Range: -0.5 to 1.5 kg a clamp; a pair of steel bars 120 x 30 x 25 mm with bolts weighs 1.5 kg.
Does: lowers B1 and B2 by 2.2 %, T1 and T2 by 0.7 to 0.9 %: clamps on the centre line hardly move in torsion.
    The same between torques. (Demo stack, nominal strength.)
Mistaken for: density or fill factor, roving accelerometers, a lower G_f.
"""

from __future__ import annotations

from model.effects.parts import clamp_unit_mass, clamps_of
from model.elements.equations import Assembly, Monomial, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the mass of one kilogram under each clamp."""
    krons = tuple(kron for clamp in clamps_of(assembly, "clamp_mass") for kron in clamp_unit_mass(assembly, clamp))
    return (Term(name="clamp_mass", target="M", factor=Monomial(exponent={"clamp_added_mass": 1}), krons=krons),)


EFFECT = Effect(
    name="clamp_mass",
    label="clamp mass",
    overstated="clamps that are lighter than stated",
    stated="the mass of the clamps",
    family="inertia",
    summary="More mass under each clamp",
    description=__doc__,
    parameters=(
        Parameter(
            name="clamp_added_mass",
            unit="kg",
            nominal=0.4,
            lower=-0.5,
            upper=1.5,
            source="steel bars and bolts of the size that presses such a stack",
        ),
    ),
    terms=terms,
)
