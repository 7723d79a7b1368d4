"""Compliance of a held edge: what holds an edge gives way, against moving and against turning apart.

A support that the stack file calls clamped, pinned or elastic has springs of the effect in series with its own, as
stiff per length of the edge and lamina as a support of the stack file: along and across alike, and against turning
about the edge. On a patch they count per length of its longer side.

Enters: stiffness of the supports, 1 / (1/k + 1/s) in place of k, where s is the effect's; not affine in s, but one
    matrix with a rational factor for each motion that is held.
Range: s from next to nothing, a free edge, to so stiff that the edge is as the stack file says; both by their
    logarithms.
Does: lowers all modes of a held stack, those most that bend at the edge. A cantilever of length L and bending
    stiffness D per width, held against turning by 10 D / L, has its first mode 16 % lower; by a tenth of D / L, 85 %.
Mistaken for: a lower Young's modulus, temperature, a length stated too short.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from model.elements.equations import Assembly, Formula, Term, Theta
from model.elements.terms import held_motions
from model.stack.effect import Effect, Parameter
from model.stack.errors import EffectError
from model.stack.parts import EdgeSupport

RIGID_EDGE = {"edge_translation": 1e13, "edge_rotation": 1e7}  # as the stack file says


def _softening(t: Theta, name: str, stiffness: float) -> Any:
    """Return the factor by which the compliance beside a stiffness, of which it is a share, takes from it."""
    return 1.0 / (1.0 + stiffness * (1.0 / t[name] - 1.0 / RIGID_EDGE[name])) - 1.0


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return what the supports' stiffness loses."""
    stack, found = assembly.stack, []
    for i, support in enumerate(stack.supports):
        width = 1.0 if isinstance(support, EdgeSupport) else min(support.size)
        for motion in held_motions(stack, assembly.plan, support):
            name = "edge_rotation" if motion.turns else "edge_translation"
            what = f"support_compliance {i} {'turning' if motion.turns else motion.kron.row}"
            factor = Formula(partial(_softening, name=name, stiffness=motion.stiffness * width))
            found.append(Term(name=what, target="K", factor=factor, krons=(motion.kron,)))
    if not found:
        raise EffectError("support_compliance: the stack has no supports; add [[supports]] to its file")
    return tuple(found)


EFFECT = Effect(
    name="support_compliance",
    label="compliance of a held edge",
    family="boundary",
    summary="A held edge gives way, against moving and against turning",
    description=__doc__,
    parameters=(
        Parameter(
            name="edge_translation",
            unit="N/m per m",
            nominal=1e8,
            lower=10.0,
            upper=RIGID_EDGE["edge_translation"],
            neutral=RIGID_EDGE["edge_translation"],
            scale="log",
            sampled=True,
            n_start=3,
            source="from a free edge to a vice; a steel jaw of 10 mm gives way by 1e11 N/m per m",
        ),
        Parameter(
            name="edge_rotation",
            unit="N m/rad per m",
            nominal=1e4,
            lower=0.1,
            upper=RIGID_EDGE["edge_rotation"],
            neutral=RIGID_EDGE["edge_rotation"],
            scale="log",
            sampled=True,
            n_start=3,
            source="from a hinge to a vice; a plate of 1 to 10 mm has 20 to 20 000 N m, over its length",
        ),
    ),
    terms=terms,
    grounded=True,
)
