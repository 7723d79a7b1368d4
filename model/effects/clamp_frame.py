"""Clamp frame: bars and rods form a frame that resists shear of the stack.

The rods stand in clearance holes or beside the stack; their bending between the bars holds top against bottom
sideways.

Enters: stiffness against the way, along x and y, by which the top runs ahead of the bottom at the footprint of
    each clamp, by the mean shear strain over the height, turning of the laminas included; affine.
Range: 0 to 2e7 N/m a clamp: 12 E I / l**3 for two to four rods of 10 to 16 mm over 64 to 100 mm.
Does: raises B1 by 8 % and B2 by 9 % at low torque and by 5 % at twice the pressure; T1 and T2, whose
    shear at the clamps cancels across the width, by less than 1 %. (Demo stack, nominal strength.)
Mistaken for: contact_offset, which does not depend on pressure either; a higher G_f.
"""

from __future__ import annotations

import numpy as np

from model.effects.parts import clamps_of, reach, shear_spring
from model.elements.equations import Assembly, Monomial, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return a spring of 1 N/m between the faces, along x and y, at each clamp."""
    stack = assembly.stack
    ahead = reach(stack)
    turned = np.full((1, stack.n_lamina), np.ptp(stack.lamina_z) / stack.n_lamina)
    krons = tuple(
        kron
        for clamp in clamps_of(assembly, "clamp_frame")
        for axis in ("x", "y")
        for kron in shear_spring(assembly, (clamp.x, clamp.y), clamp.footprint, axis, (ahead, turned))
    )
    return (Term(name="clamp_frame", target="K", factor=Monomial(exponent={"frame_stiffness": 1}), krons=krons),)


EFFECT = Effect(
    name="clamp_frame",
    label="shear stiffness of the clamp frame",
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
