"""Where the rig may stand otherwise than the files say: clamps some millimetres off."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from model import Assembly, Clamp, Effect, Kron, Monomial, Parameter, Stack, Term
from model.effects.parts import mean_over, square
from model.elements.clamping import height_shares
from model.elements.mesh import FIELDS, Field

_STEP = 2e-3  # m, over which the slope is taken
_FARTHEST = 0.02  # m


def clamp_places(stack: Stack) -> tuple[Effect, ...]:
    """Return for each clamp of a stack what it does to the equations of motion that it sits farther along x or y.

    Its mass is taken from where the file has it and put where it is, to first order of the distance (m).
    """
    return tuple(
        _placed(i, clamp, axis) for i, clamp in enumerate(stack.clamps) if clamp.mass > 0.0 for axis in (0, 1)
    )


def _name(i: int, axis: int) -> str:
    return f"clamp_{i + 1}_{'xy'[axis]}"


def _slope(assembly: Assembly, field: Field, clamp: Clamp, axis: int) -> sp.csr_matrix:
    """Return the row that takes how the mean of a field under a clamp changes as that moves along an axis."""
    half = (assembly.stack.length / 2.0, assembly.stack.width / 2.0)
    ends = [np.array([clamp.x, clamp.y]) for _ in range(2)]
    for end, step in zip(ends, (-_STEP, _STEP), strict=True):
        end[axis] = np.clip(end[axis] + step, -half[axis], half[axis])
    before, after = (mean_over(assembly, field, (x, y), clamp.footprint) for x, y in ends)
    return sp.csr_matrix((after - before) / (ends[1] - ends[0])[axis])


def _mixed(field: Field, one: sp.csr_matrix, other: sp.csr_matrix, z: sp.csr_array) -> Kron:
    return Kron(row=field, column=field, z=z, planar=(one.T @ other + other.T @ one).tocsr())


def _placed(i: int, clamp: Clamp, axis: int) -> Effect:
    name, what = _name(i, axis), f"clamp {i + 1} sits farther along {'xy'[axis]}"

    def terms(assembly: Assembly) -> tuple[Term, ...]:
        z = sp.diags_array(clamp.mass * height_shares(clamp, assembly.stack.n_lamina)).tocsr()
        linear: list[Kron] = []
        squared: list[Kron] = []
        crossed: list[Kron] = []
        for field in FIELDS:
            here = mean_over(assembly, field, (clamp.x, clamp.y), clamp.footprint)
            slope = _slope(assembly, field, clamp, axis)
            linear.append(_mixed(field, here, slope, z))
            squared.append(square(field, slope, z))
            crossed.append(_mixed(field, slope, _slope(assembly, field, clamp, 1 - axis), z))
        # mass stays positive, for it is that of the mean displacement there, to first order of both distances
        found = [
            Term(name=name, target="M", factor=Monomial(exponent={name: 1}), krons=tuple(linear)),
            Term(
                name=f"{name} squared", target="M", factor=Monomial(exponent={name: 2}), krons=tuple(squared)
            ),
        ]
        if axis == 1:
            both = Monomial(exponent={_name(i, 0): 1, name: 1})
            found.append(Term(name=f"{name} and x", target="M", factor=both, krons=tuple(crossed)))
        return tuple(found)

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
