"""Where the rig may stand otherwise than the files say: clamps some millimetres off."""

from __future__ import annotations

import numpy as np

from model import Assembly, Clamp, Effect, Kron, Monomial, Parameter, Stack, Term
from model.effects.parts import every_lamina, mean_over, square
from model.elements.mesh import FIELDS

_STEP = 2e-3  # m, over which the slope is taken
_FARTHEST = 0.02  # m


def clamp_places(stack: Stack) -> tuple[Effect, ...]:
    """Return for each clamp of a stack what it does to the equations of motion that it sits farther along x.

    Its mass is taken from where the file has it and put where it is, to first order of the distance (m).
    """
    return tuple(_placed(i, clamp) for i, clamp in enumerate(stack.clamps) if clamp.mass > 0.0)


def _placed(i: int, clamp: Clamp) -> Effect:
    name, what = f"clamp_{i + 1}_x", f"clamp {i + 1} sits farther along x"

    def terms(assembly: Assembly) -> tuple[Term, ...]:
        z, reach = clamp.mass * every_lamina(assembly.stack), assembly.stack.length / 2.0
        ends = [float(np.clip(clamp.x + step, -reach, reach)) for step in (-_STEP, _STEP)]
        linear: list[Kron] = []
        squared: list[Kron] = []
        for field in FIELDS:
            here = mean_over(assembly, field, (clamp.x, clamp.y), clamp.footprint)
            before, after = (mean_over(assembly, field, (x, clamp.y), clamp.footprint) for x in ends)
            slope = (after - before) / (ends[1] - ends[0])
            mixed = (here.T @ slope + slope.T @ here).tocsr()
            linear.append(Kron(row=field, column=field, z=z, planar=mixed))
            squared.append(square(field, slope, z))
        # the square keeps the mass positive: it is that of the mean displacement there, to first order of the distance
        return (
            Term(name=name, target="M", factor=Monomial(exponent={name: 1}), krons=tuple(linear)),
            Term(
                name=f"{name} squared", target="M", factor=Monomial(exponent={name: 2}), krons=tuple(squared)
            ),
        )

    return Effect(
        name=name,
        label=what,
        family="inertia",
        summary=what,
        description=what,
        parameters=(
            Parameter(name=name, unit="m", nominal=2e-3, lower=-_FARTHEST, upper=_FARTHEST, source="a ruler"),
        ),
        terms=terms,
    )
