"""Weld seam: a bead that ties the edges of all laminas where it runs down the side.

Two beads, in the middle of both long sides.

Enters: shear stiffness G A against the shear strain between neighbouring laminas, in the mean over 60 x 15 mm of
    them at both places, which tapers off along x, in both directions; affine.
Range: 0 to 1e6 N: G A of a bead of up to 6 x 6 mm, softened threefold or more by the thin lamina edge that it holds.
Does: raises B2 by 3.7 % and T1 by 2.4 % at low torque, somewhat more than half of it at twice the pressure; B1,
    which does not shear in the middle, and T2 stay. (Demo stack, nominal strength.)
Mistaken for: weld_pressure, adhesive_edges, edge_pressure.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from model.contact.tangential import jump, mean
from model.effects.parts import shear_spring
from model.elements.equations import Assembly, Monomial, Term
from model.stack.effect import Effect, Parameter

_GRIP = (0.06, 0.015)  # of the plan that moves with a bead; over less, its elements decide how it gives way


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return beads of G A = 1 N."""
    stack = assembly.stack
    root = sp.diags_array(np.sqrt(stack.spacing))
    slip, turned = (
        sp.diags_array(1.0 / np.sqrt(stack.spacing)) @ jump(stack.n_lamina),
        root @ mean(stack.n_lamina),
    )
    krons = tuple(
        kron
        for side in np.array([-0.5, 0.5]) * (stack.width - _GRIP[1])
        for axis in ("x", "y")
        for kron in shear_spring(assembly, (0.0, side), _GRIP, axis, (slip, turned), tapered=True)
    )
    return (Term(name="weld_seam", target="K", factor=Monomial(exponent={"bead_shear": 1}), krons=krons),)


EFFECT = Effect(
    name="weld_seam",
    label="weld seams on the long sides",
    family="treatments",
    summary="Beads tie the laminas at the middle of both sides",
    description=__doc__,
    parameters=(
        Parameter(
            name="bead_shear",
            unit="N",
            nominal=100000.0,
            lower=0.0,
            upper=1000000.0,
            source="G A of a bead of up to 6 x 6 mm, a third of it for the lamina edge",
        ),
    ),
    terms=terms,
)
