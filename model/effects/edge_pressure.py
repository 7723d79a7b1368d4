"""Edge pressure: burrs of the cut carry the pressure at the long edges.

Enters: pressure p (1 + a f(x, y)), f grows with the square of y, less its mean. Stiffness is affine in a,
    damping a polynomial of it.
Range: a from -0.45 (bowed sheets touch in the middle) to 0.95 (burrs carry).
Does: burrs raise T1 by 14 %, T2 by 0 to 4 %, and lower bending by 0.1 to 0.2 %; damping of T1 grows too.
    (Demo stack, nominal strength.)
Mistaken for: contact_direction, adhesive_edges.
"""

from __future__ import annotations

import numpy as np

from lamella_shared import Reals
from model.effects.parts import pressure_change
from model.elements.equations import Assembly, Term
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the change of the pressure field."""
    stack = assembly.stack

    def shape(x: Reals, y: Reals) -> Reals:
        return np.asarray((2.0 * y / stack.width) ** 2 + 0.0 * x)

    return pressure_change(assembly, "edge_pressure", "edge_excess", shape)


EFFECT = Effect(
    name="edge_pressure",
    label="pressure concentration along the long edges",
    family="pressure field",
    summary="Edge pressure",
    description=__doc__,
    parameters=(
        Parameter(
            name="edge_excess",
            unit="1",
            nominal=0.4,
            lower=-0.45,
            upper=0.95,
            source="a from -0.9 (bowed sheets touch in the middle) to 0.95 (burrs carry)",
        ),
    ),
    terms=terms,
)
