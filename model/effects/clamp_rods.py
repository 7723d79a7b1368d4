"""Clamp rods: the threaded rods tie the two faces and stiffen the stack across its height.

Bars on both faces of each clamp, joined by two rods, act as a spring between top and bottom.

Enters: stiffness between w of top and bottom at the footprint of each clamp, by the mean strain over the
    height; affine.
Range: 0 to 4e8 N/m a clamp: two steel rods of 8 to 12 mm over 64 to 100 mm, E A / l.
Does: nothing that one can measure to T1, B1, B2, T2 (below 0.001 %); raises thickness modes. (Demo stack,
    nominal strength.)
Mistaken for: normal_stiffness.
"""

from __future__ import annotations

from model.effects.parts import clamps_of, mean_over, square, tie
from model.elements.equations import Assembly, Monomial, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return a spring of 1 N/m between the faces at each clamp."""
    across = tie(assembly.stack)
    krons = tuple(
        square("w", mean_over(assembly, "w", (clamp.x, clamp.y), clamp.footprint), across)
        for clamp in clamps_of(assembly, "clamp_rods")
    )
    return (Term(name="clamp_rods", target="K", factor=Monomial(exponent={"rod_stiffness": 1}), krons=krons),)


EFFECT = Effect(
    name="clamp_rods",
    label="axial stiffness of the clamp rods",
    family="boundary",
    summary="Rods tie top and bottom face at the clamps",
    description=__doc__,
    parameters=(
        Parameter(
            name="rod_stiffness",
            unit="N/m",
            nominal=100000000.0,
            lower=0.0,
            upper=400000000.0,
            source="E A / l of two steel rods M8 to M12",
        ),
    ),
    terms=terms,
)
