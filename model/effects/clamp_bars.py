"""Bending of the clamp bars: bars across the width keep the section under each clamp from bending.

A bar on either face bends with the laminas in the mean.

Enters: bending stiffness E I w_yy**2 along the width, w the cubic over y that lies closest to the mean deflection of
    the laminas under each clamp. E I = 20 N m2 s / (1 - s) with the hold s: at one half, a bar takes about half of
    what a rigid one would.
Range: hold 0 to 0.98: a steel bar of 30 x 20 mm has 4000 N m2 and would be rigid; lying on its edges, or on what is
    soft, it holds less.
Does: next to nothing to T1, B1 and B2; raises T2 by 0.2 % at low torque. Modes that bend the section rise by up to
    1.3 %. (Demo stack, nominal strength.)
Mistaken for: clamp_rods, steel orthotropy.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import legendre

from model.effects.parts import clamps_of, mean_lamina
from model.elements.equations import Assembly, Formula, Kron, Term, Theta
from model.elements.terms import footprint_points
from model.stack.effect import Effect, Parameter


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return bars of 1 N m2 on both faces at each clamp."""
    stack = assembly.stack
    lengths = {clamp.x: clamp.footprint[0] for clamp in clamps_of(assembly, "clamp_bars")}
    both = 2.0 * mean_lamina(stack)
    krons = tuple(
        Kron(row="w", column="w", z=both, planar=_bar(assembly, x, length)) for x, length in sorted(lengths.items())
    )
    return (Term(name="clamp_bars", target="K", factor=Formula(_rigidity), krons=krons),)


def _rigidity(t: Theta) -> Any:
    half = 20.0  # N m2, half as much as a rigid bar on the demo stack
    return half * t["bar_hold"] / (1.0 - t["bar_hold"])


def _bar(assembly: Assembly, x: float, length: float) -> sp.csr_matrix:
    """Return the bending energy, twice, of the cubic over y that lies closest to w under a bar of 1 N m2."""
    degree = 3  # of a bar's deflection: an arc and an S; finer forms lie between the elements of a usual mesh
    on_plan = 1e-6  # of the width, within which a point lies on the plan
    plan, width = assembly.plan, assembly.stack.width
    points, weights = footprint_points((x, 0.0), (length, width), plan)
    on_it = np.linalg.norm(plan.nearest(points) - points, axis=1) < on_plan * width
    points, weights = points[on_it], weights[on_it]
    forms = np.sqrt(weights)[:, None] * legendre.legvander(2.0 * points[:, 1] / width, degree)
    closest = sp.csr_matrix(np.linalg.pinv(forms) * np.sqrt(weights)) @ plan.point_rows("w", points)
    bend = legendre.legval(2.0 * points[:, 1] / width, legendre.legder(np.eye(degree + 1), 2)).T
    rigidity = (2.0 / width) ** 4 * width * (bend.T * weights) @ bend
    return (closest.T @ sp.csr_matrix(rigidity) @ closest).tocsr()


EFFECT = Effect(
    name="clamp_bars",
    label="bending stiffness of the clamp bars",
    family="boundary",
    summary="Bending stiffness of the bars across the faces",
    description=__doc__,
    parameters=(
        Parameter(
            name="bar_hold",
            unit="1",
            nominal=0.8,
            lower=0.0,
            upper=0.98,
            source="none to that of a bar fifty times as stiff as the laminas under it",
        ),
    ),
    terms=terms,
)
