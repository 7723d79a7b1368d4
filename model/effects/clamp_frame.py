"""Clamp frame: bars and rods form a frame that resists shear of the stack.

The rods stand in clearance holes or beside the stack; their bending between the bars holds top against bottom
sideways.

Enters: stiffness between u (and v) of top and bottom at the footprint of each clamp, by the mean strain over
    the height; affine.
Range: 0 to 2e7 N/m a clamp: 12 E I / l**3 for two to four rods of 10 to 16 mm over 64 to 100 mm.
Does: raises all modes that shear the stack, B1 and B2 at clamps off the middle; more at low torque, where the
    contact is softer.
Mistaken for: contact_offset, which does not depend on pressure either; a higher G_f.
"""

from __future__ import annotations

from model.effect import Effect, Parameter
from model.effect_parts import clamps_of, mean_over, square, tie
from model.system import Assembly, Monomial, Term


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return a spring of 1 N/m between the faces, along x and y, at each clamp."""
    across = tie(assembly.stack)
    krons = tuple(
        square(field, mean_over(assembly, field, (clamp.x, clamp.y), clamp.footprint), across)
        for clamp in clamps_of(assembly, "clamp_frame")
        for field in ("u", "v")
    )
    return (
        Term(name="clamp_frame", target="K", factor=Monomial(exponent={"frame_stiffness": 1}), krons=krons),
    )


EFFECT = Effect(
    name="clamp_frame",
    family="boundary",
    summary="The frame of bars and rods resists shear",
    description=__doc__,
    parameters=(
        Parameter(
            name="frame_stiffness",
            unit="N/m",
            nominal=6000000.0,
            lower=0.0,
            upper=20000000.0,
            source="12 E I / l**3 of two to four rods of 10 to 16 mm",
        ),
    ),
    terms=terms,
)
