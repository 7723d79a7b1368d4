"""Whether a mass or a spring at one of the measured points explains what a model leaves: an effect that none need know.

The squared misfit of hundreds of values hides a change that shows in few directions of them, as what sits at one place
does. To first order a mass or a spring at a point is as easily tried as an effect of the catalogue, and that the best
of all points was chosen is counted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from model import Effect, Parameter
from model.elements.equations import Monomial, Target
from model.reduction.reduced_equations import ReducedTerm
from updating.diagnosis.adequacy import block_p_value
from updating.diagnosis.chance import chance_of_gain
from updating.diagnosis.coordinates import scaled
from updating.diagnosis.evidence import Evidence
from updating.diagnosis.explanation import Explanation
from updating.diagnosis.screening import screen, stepped

Kind = Literal["mass", "spring"]

P_POINT = 0.005
"""Probability of as good an explanation by chance, below which something is there."""
_DATA = ("frequency", "damping", "shape")
_MOST: dict[Kind, tuple[Target, str, float]] = {"mass": ("M", "kg", 1.0), "spring": ("K", "N/m", 1e7)}
"""Of each kind the matrix that it adds to, its unit, and the most that is tried, less or more."""


@dataclass(frozen=True, kw_only=True)
class PointChange:
    """The change at a single point that explains most of what a model leaves, by a linear step.

    Attributes
    ----------
    beside : tuple of str
        Effects that the model has.
    node : int
        The measured point.
    kind : "mass" or "spring"
        What acts there, in the measured direction; a spring is fixed to the ground.
    size : float
        How much of it, kg or N/m; negative where the model has too much.
    gain : float
        Fall of the squared misfit.
    chance : float
        Probability that the best of all points explains as much where the model is complete.
    p_value : float
        Probability of a misfit as large as what the step leaves, if nothing else were missing: the smallest of those of
        frequencies, damping ratios and shapes, times three (Bonferroni).
    """

    beside: tuple[str, ...]
    node: int
    kind: Kind
    size: float
    gain: float
    chance: float
    p_value: float


def point_change(evidence: Evidence, at: Explanation) -> PointChange:
    """Return the change at one measured point that explains most of what an explanation leaves.

    Parameters
    ----------
    evidence : Evidence
        Measurement and model.
    at : Explanation
        What is fitted already is taken out by projection.
    """
    observed = max(evidence.observed, key=lambda own: own.node.size)
    equations, terms, effects = evidence.equations, [], {}
    for i, row in enumerate(observed.reduced_rows):
        square = np.outer(row, row)
        for kind, (target, unit, most) in _MOST.items():
            name = f"{kind}_{i}"
            factor = Monomial(exponent={name: 1})
            terms.append(ReducedTerm(name=name, target=target, factor=factor, matrix=square))
            effects[name] = _anywhere(name, unit, most)
    richer = replace(
        equations,
        terms=(*equations.terms, *terms),
        theta={**equations.theta, **dict.fromkeys(effects, 0.0)},
    )
    screened = screen(replace(evidence, equations=richer, effects=effects), at)
    best = max(screened, key=lambda own: own.gain)
    left = stepped(at, best)
    return PointChange(
        beside=at.effects,
        node=int(observed.node[int(best.effect.partition("_")[2])]),
        kind="mass" if best.effect.startswith("mass") else "spring",
        size=scaled(best.parameter[0], float(best.start[0]))[0],
        gain=best.gain,
        chance=chance_of_gain(screened, best.gain),
        p_value=min(1.0, len(_DATA) * min(block_p_value(left, kind) for kind in _DATA)),
    )


def _anywhere(name: str, unit: str, most: float) -> Effect:
    """Return an effect of which only the parameter is used: its term is made in the reduced equations."""
    text = "a change at one point"
    parameter = Parameter(name=name, unit=unit, nominal=most, lower=-most, upper=most, source=text)
    return Effect(
        name=name,
        family="inertia",
        summary=text,
        description=text,
        parameters=(parameter,),
        terms=lambda _: (),
    )
