"""Explanations in the order of their probability."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from updating.diagnosis.held_out import held_out_error
from updating.diagnosis.search import Search


@dataclass(frozen=True, kw_only=True)
class ParameterEstimate:
    """A parameter with its 90 % interval, in `unit`."""

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
    score : float
        Share of the base model's misfit, beyond what is expected of a complete model, that it explains.
    misfit : float
        Squared length of the whitened residual.
    distance : float
        Discrimination distance from the explanation of least misfit: below 3 the data cannot tell the two apart.
    probability : float
        Posterior probability among all that were fitted.
    parameter : tuple of ParameterEstimate
        Its parameters.
    frequency_error : float
        Mean relative frequency error, eq. (2), over the modes used.
    held_out_error : float
        The same where each mode is predicted from all others, to first order; NaN where none can be.
    """

    effects: tuple[str, ...]
    score: float
    misfit: float
    distance: float
    probability: float
    parameter: tuple[ParameterEstimate, ...]
    frequency_error: float
    held_out_error: float


def rank(found: Search) -> tuple[Ranked, ...]:
    """Rank explanations by posterior probability: none, one or two effects have 1/2, 2/5 and 1/10 beforehand."""
    n, base, every = len(found.evidence.effects), found.base, found.explanations
    weight = np.log([0.5, 0.4 / max(n, 1), 0.1 / max(n * (n - 1) // 2, 1)])
    score = np.array([weight[len(x.effects)] + x.log_evidence for x in every])
    probability = np.exp(score - score.max())
    probability /= probability.sum()
    expected = base.residual.value.size - len(found.evidence.nuisances)
    least = min(x.misfit for x in every)
    excess = max(base.misfit - min(expected, base.misfit * 0.5), 1e-12)
    ranked = [
        Ranked(
            effects=x.effects,
            score=float(np.clip((base.misfit - x.misfit) / excess, 0.0, 1.0)),
            misfit=x.misfit,
            distance=float(np.sqrt(x.misfit - least)),
            probability=float(chance),
            parameter=tuple(
                ParameterEstimate(
                    name=p.name,
                    unit=p.unit,
                    value=float(x.value[i]),
                    lower=float(x.lower[i]),
                    upper=float(x.upper[i]),
                    at_bound=bool(x.at_bound[i]),
                )
                for i, p in enumerate(x.parameter)
            ),
            frequency_error=float(np.mean(np.abs(np.expm1(-x.residual.log_frequency)))),
            held_out_error=held_out_error(x.residual),
        )
        for x, chance in zip(every, probability, strict=True)
    ]
    return tuple(sorted(ranked, key=lambda x: -x.probability))
