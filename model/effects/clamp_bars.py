"""Bending of the clamp bars: bars across the width stiffen the faces under each clamp.

A bar on either face bends with the lamina under it.

Enters: bending stiffness E I w_yy**2 along the width at each clamp, spread over the height; affine.
Range: 0 to 2e4 N m2 a bar: steel bars of 25 to 40 mm width and 10 to 30 mm height.
Does: next to nothing to T1, B1 and B2; raises T2 by 0.1 % at low torque. Modes that bend the section rise
    more. (Demo stack, nominal strength.)
Mistaken for: clamp_rods, steel orthotropy.
"""

from __future__ import annotations

import numpy as np

from model.effect import Effect, Parameter
from model.effect_parts import clamps_of, every_lamina
from model.system import Assembly, Kron, Monomial, Term

_POINTS = 24


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return bars of 1 N m2 on both faces at each clamp."""
    stack = assembly.stack
    nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
    y, dy = nodes * stack.width / 2.0, weights * stack.width / 2.0
    krons = []
    for x in sorted({clamp.x for clamp in clamps_of(assembly, "clamp_bars")}):
        curvature = assembly.plan.point_rows("w", np.column_stack([np.full(_POINTS, x), y]), "yy")
        planar = (curvature.T @ curvature.multiply(dy[:, None])).tocsr()
        krons.append(Kron(row="w", column="w", z=2.0 * every_lamina(stack), planar=planar))
    factor = Monomial(exponent={"bar_rigidity": 1})
    return (Term(name="clamp_bars", target="K", factor=factor, krons=tuple(krons)),)


EFFECT = Effect(
    name="clamp_bars",
    family="boundary",
    summary="Bending stiffness of the bars across the faces",
    description=__doc__,
    parameters=(
        Parameter(
            name="bar_rigidity",
            unit="N m2",
            nominal=5000.0,
            lower=0.0,
            upper=20000.0,
            source="E I of steel bars 25 to 40 mm wide and 10 to 30 mm high",
        ),
    ),
    terms=terms,
)
