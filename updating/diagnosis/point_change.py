"""Whether a mass or a spring at one of the measured points explains what a model leaves: an effect that none need know.

To first order a mass or a spring at a point is as easily tried as an effect of the catalogue, and that the best of all
points was chosen is counted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from model import Effect, Parameter
from model.elements.equations import Monomial, Target
from model.reduction.reduced_equations import ReducedTerm
from updating.diagnosis.calibration import MOST, POINT_SHOWS
from updating.diagnosis.coordinates import scaled
from updating.diagnosis.evidence import Evidence
from updating.diagnosis.explanation import Explanation
from updating.diagnosis.screening import screen

Kind = Literal["mass", "spring"]

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
    log_odds : float
        Logarithm of the odds that it brings, the number of points counted.
    """

    beside: tuple[str, ...]
    node: int
    kind: Kind
    size: float
    log_odds: float


def point_change(evidence: Evidence, at: Explanation) -> PointChange | None:
    """Return the change at one measured point that explains most of what an explanation leaves; None where none does.

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
    fitted = {name: evidence.effects[name] for name in at.effects if name in evidence.effects}
    screened = screen(replace(evidence, equations=richer, effects={**fitted, **effects}), at)
    best = max(screened, key=lambda own: own.log_gain)
    log_odds = best.log_gain - float(np.log(len(effects)))
    left = at.misfit - at.residual.value.size  # beyond what the degrees of freedom leave
    if log_odds < POINT_SHOWS or best.gain < MOST * left:
        return None
    return PointChange(
        beside=at.effects,
        node=int(observed.node[int(best.effect.partition("_")[2])]),
        kind="mass" if best.effect.startswith("mass") else "spring",
        size=scaled(best.parameter[0], float(best.start[0]))[0],
        log_odds=log_odds,
    )


def _anywhere(name: str, unit: str, most: float) -> Effect:
    """Return an effect of which only the parameter is used: its term is made in the reduced equations."""
    text = "a change at one point"
    parameter = Parameter(name=name, unit=unit, nominal=most, lower=-most, upper=most, source=text)
    return Effect(
        name=name,
        label="change at one point",
        family="inertia",
        summary=text,
        description=text,
        parameters=(parameter,),
        terms=lambda _: (),
    )
