"""Bending of the clamp bars: bars across the width stiffen the faces under each clamp.

A bar on either face bends with the lamina under it.

Enters: bending stiffness E I w_yy**2 along the width, w the cubic over y that lies closest to the deflection under
    each clamp, spread over the height; affine.
Range: 0 to 2e4 N m2 a bar: steel bars of 25 to 40 mm width and 10 to 30 mm height.
Does: next to nothing to T1, B1 and B2; raises T2 by 0.3 % at low torque. Modes that bend the section rise
    more. (Demo stack, nominal strength.)
Mistaken for: clamp_rods, steel orthotropy.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import legendre

from model.clamping import footprint_points
from model.effect import Effect, Parameter
from model.effect_parts import clamps_of, every_lamina
from model.system import Assembly, Kron, Monomial, Term

_ON_PLAN = 1e-6  # of the width, within which a point lies on the plan
_DEGREE = 3  # of a bar's deflection: an arc and an S; finer forms lie between the elements of a usual mesh


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return bars of 1 N m2 on both faces at each clamp."""
    stack = assembly.stack
    lengths = {clamp.x: clamp.footprint[0] for clamp in clamps_of(assembly, "clamp_bars")}
    krons = tuple(
        Kron(row="w", column="w", z=2.0 * every_lamina(stack), planar=_bar(assembly, x, length))
        for x, length in sorted(lengths.items())
    )
    factor = Monomial(exponent={"bar_rigidity": 1})
    return (Term(name="clamp_bars", target="K", factor=factor, krons=krons),)


def _bar(assembly: Assembly, x: float, length: float) -> sp.csr_matrix:
    """Return the bending energy, twice, of the cubic over y that lies closest to w under a bar of 1 N m2."""
    plan, width = assembly.plan, assembly.stack.width
    points, weights = footprint_points((x, 0.0), (length, width), plan)
    on_it = np.linalg.norm(plan.nearest(points) - points, axis=1) < _ON_PLAN * width
    points, weights = points[on_it], weights[on_it]
    forms = np.sqrt(weights)[:, None] * legendre.legvander(2.0 * points[:, 1] / width, _DEGREE)
    closest = sp.csr_matrix(np.linalg.pinv(forms) * np.sqrt(weights)) @ plan.point_rows("w", points)
    bend = legendre.legval(2.0 * points[:, 1] / width, legendre.legder(np.eye(_DEGREE + 1), 2)).T
    rigidity = (2.0 / width) ** 4 * width * (bend.T * weights) @ bend
    return (closest.T @ sp.csr_matrix(rigidity) @ closest).tocsr()


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
