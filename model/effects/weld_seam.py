"""Weld seams: beads that tie the edges of all laminas where they run down the sides.

Beads on both long sides, in the middle and at a quarter of the length to either side of it.

Enters: shear stiffness G A against the shear strain between neighbouring laminas, in the mean over 60 x 15 mm of
    them at each place, which tapers off along x, in both directions; affine in the beads of the middle and in those
    beside it. The side s moves them between the long sides: the beads there have 1 + s and 1 - s of it.
Range: 0 to 1e6 N: G A of a bead of up to 6 x 6 mm, softened threefold or more by the thin lamina edge that it holds.
    s from -1 to 1, beads on one side alone.
Does: beads in the middle raise B2 by 3.7 % and T1 by 2.4 % at low torque, somewhat more than half of it at twice the
    pressure; B1, which does not shear in the middle, and T2 stay. (Demo stack, nominal strength.) Beads on one
    side make bending modes twist.
Mistaken for: weld_pressure, adhesive_edges, edge_pressure.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from model.contact.contact import jump, mean
from model.effects.parts import shear_spring
from model.elements.equations import Assembly, Formula, Kron, Term, Theta
from model.stack.effect import Effect, Parameter

_SHEAR = "G A of a bead of up to 6 x 6 mm, a third of it for the lamina edge"


def _on_side(t: Theta, name: str, side: float) -> Any:
    return t[name] * (1.0 + side * t["bead_side"])


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return beads of G A = 1 N, those of each parameter and side together."""
    places = {"bead_shear": (0.0,), "quarter_shear": (-0.25, 0.25)}  # along the stack, of its length
    # Of the plan that moves with a bead; over less, its elements decide how it gives way
    grip = (0.06, 0.015)
    stack = assembly.stack
    root = sp.diags_array(np.sqrt(stack.spacing))
    over_z = (sp.diags_array(1.0 / np.sqrt(stack.spacing)) @ jump(stack.n_lamina), root @ mean(stack.n_lamina))

    def beads(name: str, side: float) -> tuple[Kron, ...]:
        y = 0.5 * side * (stack.width - grip[1])
        centres = [(share * stack.length, y) for share in places[name]]
        return tuple(
            kron
            for centre in centres
            for axis in ("x", "y")
            for kron in shear_spring(assembly, centre, grip, axis, over_z, tapered=True)
        )

    return tuple(
        Term(
            name=f"weld_seam {name} at {'+' if side > 0.0 else '-'}y",
            target="K",
            factor=Formula(partial(_on_side, name=name, side=side)),
            krons=beads(name, side),
        )
        for name in places
        for side in (-1.0, 1.0)
    )


EFFECT = Effect(
    name="weld_seam",
    label="weld seams on the long sides",
    family="treatments",
    summary="Beads tie the laminas on one or both long sides, in the middle or beside it",
    description=__doc__,
    parameters=(
        Parameter(
            name="bead_shear", unit="N", nominal=100000.0, lower=0.0, upper=1000000.0, source=f"in the middle: {_SHEAR}"
        ),
        Parameter(
            name="quarter_shear",
            unit="N",
            nominal=0.0,
            lower=0.0,
            upper=1000000.0,
            source=f"at a quarter of the length from it: {_SHEAR}",
        ),
        Parameter(
            name="bead_side",
            unit="1",
            nominal=0.0,
            lower=-1.0,
            upper=1.0,
            source="1 where all beads are on the side of positive y, -1 on the other",
        ),
    ),
    terms=terms,
)
