"""Explanations in the order of their probability."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from updating.diagnosis.discrepancy import Sizes
from updating.diagnosis.explanation import Explanation
from updating.diagnosis.held_out import left_out
from updating.diagnosis.search import Search


@dataclass(frozen=True, kw_only=True)
class ParameterEstimate:
    """A parameter with its 95 % interval, in `unit`."""

    name: str
    unit: str
    value: float
    lower: float
    upper: float
    at_bound: bool


@dataclass(frozen=True, kw_only=True)
class Ranked:
    """One explanation in the ranking.

    Attributes
    ----------
    effects : tuple of str
        Which.
    explained : float
        Share of the misfit that it explains: of the squared logarithms of measured over modelled frequencies and
        damping ratios and of what shapes differ by, each over the discrepancy that the best explanation leaves.
    log_odds : float
        Logarithm of the posterior odds against the base model.
    probability : float
        Posterior probability among all that were fitted.
    parameter : tuple of ParameterEstimate
        Its parameters.
    frequency_error : float
        Mean relative frequency error, eq. (2), over the modes used.
    left_out_error : float
        The same where each mode is predicted from all others, to first order; NaN where none can be.
    discrepancy : Sizes
        What it leaves beside the noise: of a frequency, of a damping ratio, of a shape's length.
    """

    effects: tuple[str, ...]
    explained: float
    log_odds: float
    probability: float
    parameter: tuple[ParameterEstimate, ...]
    frequency_error: float
    left_out_error: float
    discrepancy: Sizes


def rank(found: Search) -> tuple[Ranked, ...]:
    """Rank explanations by posterior probability."""
    every = found.explanations
    odds = np.array([found.odds(x) for x in every])
    probability = np.exp(odds - odds.max())
    probability /= probability.sum()
    ranked = [
        Ranked(
            effects=x.effects,
            explained=explained(found.base, x),
            log_odds=float(own),
            probability=float(chance),
            parameter=_estimates(x),
            frequency_error=x.residual.frequency_error,
            left_out_error=left_out(found.evidence, x.residual).frequency,
            discrepancy=x.mean,
        )
        for x, own, chance in zip(every, odds, probability, strict=True)
    ]
    return tuple(sorted(ranked, key=lambda x: -x.probability))


def explained(base: Explanation, own: Explanation) -> float:
    """Return the share of the base model's misfit that an explanation explains."""
    return float(np.clip(1.0 - own.misfit / base.misfit, 0.0, 1.0))


def _estimates(own: Explanation) -> tuple[ParameterEstimate, ...]:
    return tuple(
        ParameterEstimate(
            name=p.name,
            unit=p.unit,
            value=float(own.value[i]),
            lower=float(own.lower[i]),
            upper=float(own.upper[i]),
            at_bound=bool(own.at_bound[i]),
        )
        for i, p in enumerate(own.parameter)
    )
