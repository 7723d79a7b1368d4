"""Added mass at an unknown location: something that hangs on the stack, or lies on it, and is in no file.

A tool, a fitting, a stiff cable or a block that was left on the top or the bottom face. It moves with the sheets
under it: up and down with their mean, along and across with what a linear motion over the height has at a face.

Enters: mass matrix, affine in the mass. A location is shared smoothly among the nearest of places on a grid, so that
    the mass acts as a block of a seventh of the length would, whatever its location.
Range: up to 1 kg, a fourteenth of the sheets of the published stack; anywhere on the plan.
Does: lowers most the modes that move most there: at the nominal location T1 by 1.3 %, B1 by 0.3 %, B2 by 0.2 % and
    T2 by 0.1 to 0.4 %; shapes lose their symmetry. (Demo stack, nominal strength.)
Mistaken for: lost contact in a corner, moving mass at the shaker, a size that was stated wrongly.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from model.effects.parts import mean_lamina, shared_among, square, tie
from model.elements.equations import Assembly, Formula, Term, Theta
from model.elements.mesh import FIELDS
from model.stack.effect import Effect, Parameter
from model.stack.errors import EffectError


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the mass of one kilogram at each place, with its share of what lies elsewhere."""
    # Places along the shorter side at least: the turning of a narrow stack is off by a sixteenth at its sides.
    fewest = 5
    # Places along the longer side: a mass counts at most a fifth too little in the second bending mode, where it moves
    # most, for it is spread with a standard deviation of half a step.
    long = 13
    stack = assembly.stack
    if stack.outline is not None:
        raise EffectError("added_mass: its location is looked for on a rectangle, and an outline is none")
    longer = max(stack.length, stack.width)
    n_x, n_y = (max(fewest, round(1 + (long - 1) * side / longer)) for side in (stack.length, stack.width))
    mean = mean_lamina(stack)
    # The square at a face, in the mean of both, of a motion that is linear over the height.
    face = mean + 0.25 * tie(stack)
    over_z = {"u": face, "v": face, "w": mean}
    found = []
    for i, x in enumerate(np.linspace(-1.0, 1.0, n_x)):
        for j, y in enumerate(np.linspace(-1.0, 1.0, n_y)):
            at = 0.5 * np.array([[x * stack.length, y * stack.width]])
            found.append(
                Term(
                    name=f"added_mass at {x:.3f} and {y:.3f}",
                    target="M",
                    factor=Formula(partial(_share, i=i, j=j, n=(n_x, n_y))),
                    krons=tuple(square(f, assembly.plan.point_rows(f, at), over_z[f]) for f in FIELDS),
                )
            )
    return tuple(found)


def _share(t: Theta, i: int, j: int, n: tuple[int, int]) -> Any:
    along, across = (shared_among(t[name], k, -1.0, 1.0) for name, k in zip(("added_x", "added_y"), n, strict=True))
    return t["added_mass"] * along[i] * across[j]


EFFECT = Effect(
    name="added_mass",
    label="added mass at an unknown location",
    family="inertia",
    summary="Added mass at an unknown location",
    description=__doc__,
    parameters=(
        Parameter(
            name="added_mass",
            unit="kg",
            nominal=0.2,
            lower=0.0,
            upper=1.0,
            source="what is left on a stack or hung on it: up to 1 kg, a fourteenth of the sheets",
        ),
        Parameter(
            name="added_x",
            unit="1",
            nominal=0.6,
            lower=-1.0,
            upper=1.0,
            source="anywhere along the stack, -1 and 1 at its ends",
            n_start=3,
        ),
        Parameter(
            name="added_y",
            unit="1",
            nominal=0.5,
            lower=-1.0,
            upper=1.0,
            source="anywhere across the stack, -1 and 1 at its sides",
            n_start=3,
        ),
    ),
    terms=terms,
)
