"""Places of the rig that may differ from the files: clamps some millimetres off."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import scipy.sparse as sp

from model import Assembly, Clamp, Effect, Kron, Monomial, Parameter, Stack, Term
from model.effects.parts import mean_over
from model.elements.mesh import FIELDS, Field
from model.elements.terms import height_shares

_FARTHEST = 0.02  # m
_AT = np.array([-0.016, -0.005, 0.005, 0.016])  # m, where means are taken for the polynomials
_DEGREE = (
    3,
    2,
)  # of those along x and y: a parabola is right to 2 % of frequencies at 20 mm, a cubic to 0.1 %


def clamp_places(stack: Stack) -> tuple[Effect, ...]:
    """Return for each clamp of a stack what it does to the equations of motion that it sits farther along x or y.

    Its mass is taken from where the file has it and put where it is. What it moves with is the mean displacement under
    it, of third order in the distance (m) along x: at the crest of a mode, the first order alone says that nothing
    changes, and then the square of the slope counts that comes from where the mode has a node.
    """
    return tuple(
        _placed(i, clamp, axis) for i, clamp in enumerate(stack.clamps) if clamp.mass > 0.0 for axis in (0, 1)
    )


def _name(i: int, axis: int) -> str:
    return f"clamp_{i + 1}_{'xy'[axis]}"


@functools.lru_cache(maxsize=len(FIELDS))  # those along y are asked for after those along x
def _powers(assembly: Assembly, field: Field, clamp: Clamp) -> dict[tuple[int, int], sp.csr_matrix]:
    """Return the rows whose sum, each times powers of the distances along x and y, takes the mean under a clamp.

    Along each axis it is the polynomial through the mean here that comes nearest to those at some other places, the
    nearer the better. Off the stack a clamp has no place, and moves with the edge: shapes that are continued beyond it
    turn millimetres into an inertia that no clamp has. Near an edge, where that is a kink, all places count.
    """

    def mean_at(x: float, y: float) -> sp.csr_matrix:
        return mean_over(assembly, field, (x, y), clamp.footprint)

    rows = {(0, 0): mean_at(clamp.x, clamp.y)}
    for along, place, size, degree in (
        ((1, 0), clamp.x, assembly.stack.length, _DEGREE[0]),
        ((0, 1), clamp.y, assembly.stack.width, _DEGREE[1]),
    ):
        within = np.clip(_AT, -size / 2.0 - place, size / 2.0 - place)
        changes = [
            mean_at(clamp.x + d * along[0], clamp.y + d * along[1]) - rows[0, 0] for d in within.tolist()
        ]
        powers = np.arange(1, degree + 1)
        weight = np.abs(_AT) ** (-4.0 if np.all(within == _AT) else -1.0)
        shares = np.linalg.pinv(weight[:, None] * _AT[:, None] ** powers) * weight
        for power, share in zip(powers.tolist(), shares.tolist(), strict=True):
            parts = (part * change for part, change in zip(share, changes, strict=True))
            rows[power * along[0], power * along[1]] = sum(parts, start=0.0 * rows[0, 0])
    return rows


def _placed(i: int, clamp: Clamp, axis: int) -> Effect:
    name, what = _name(i, axis), f"clamp {i + 1} sits farther along {'xy'[axis]}"

    def terms(assembly: Assembly) -> tuple[Term, ...]:
        z = sp.diags_array(clamp.mass * height_shares(clamp, assembly.stack.n_lamina)).tocsr()
        krons: dict[tuple[int, int], list[Kron]] = {}
        for field in FIELDS:
            rows = _powers(assembly, field, clamp)
            products: dict[tuple[int, int], sp.csr_matrix] = {}
            # the mass stays positive, for it is that of the square of one displacement with all its powers
            for (m, first), (n, second) in itertools.product(rows.items(), repeat=2):
                power = (m[0] + n[0], m[1] + n[1])
                products[power] = products.get(power, 0.0 * (first.T @ first)) + first.T @ second
            for power, planar in products.items():
                kron = Kron(row=field, column=field, z=z, planar=planar.tocsr())
                krons.setdefault(power, []).append(kron)
        return tuple(
            Term(
                name=f"{name} {power[0]} {power[1]}",
                target="M",
                factor=Monomial(
                    exponent={_name(i, axis_of_power): n for axis_of_power, n in enumerate(power) if n}
                ),
                krons=tuple(krons_of_power),
            )
            for power, krons_of_power in krons.items()
            if (power[1] > 0 if axis == 1 else power[0] > 0 == power[1])
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
