"""Where the rig may stand otherwise than the files say: clamps some millimetres off."""

from __future__ import annotations

import numpy as np

from model import Assembly, Clamp, Effect, Kron, Monomial, Parameter, Stack, Term
from model.effects.parts import every_lamina, mean_over, square
from model.elements.mesh import FIELDS

_STEP = 2e-3  # m, over which the slope is taken
_FARTHEST = 0.02  # m


def clamp_places(stack: Stack) -> tuple[Effect, ...]:
    """Return for each clamp of a stack what it does to the equations of motion that it sits farther along x or y.

    Its mass is taken from where the file has it and put where it is, to first order of the distance (m).
    """
    return tuple(
        _placed(i, clamp, axis) for i, clamp in enumerate(stack.clamps) if clamp.mass > 0.0 for axis in (0, 1)
    )


def _placed(i: int, clamp: Clamp, axis: int) -> Effect:
    name, what = f"clamp_{i + 1}_{'xy'[axis]}", f"clamp {i + 1} sits farther along {'xy'[axis]}"

    def terms(assembly: Assembly) -> tuple[Term, ...]:
        z = clamp.mass * every_lamina(assembly.stack)
        half = (assembly.stack.length / 2.0, assembly.stack.width / 2.0)
        ends = [np.array([clamp.x, clamp.y]) for _ in range(2)]
        for end, step in zip(ends, (-_STEP, _STEP), strict=True):
            end[axis] = np.clip(end[axis] + step, -half[axis], half[axis])
        linear: list[Kron] = []
        squared: list[Kron] = []
        for field in FIELDS:
            here = mean_over(assembly, field, (clamp.x, clamp.y), clamp.footprint)
            before, after = (mean_over(assembly, field, (x, y), clamp.footprint) for x, y in ends)
            slope = (after - before) / (ends[1] - ends[0])[axis]
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

    parameter = Parameter(
        name=name, unit="m", nominal=2e-3, lower=-_FARTHEST, upper=_FARTHEST, source="a ruler"
    )
    return Effect(
        name=name,
        label=what,
        family="inertia",
        summary=what,
        description=what,
        parameters=(parameter,),
        terms=terms,
    )
