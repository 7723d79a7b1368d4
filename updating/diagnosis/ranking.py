"""Explanations in the order of their probability."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from updating.diagnosis.answer import Ranked
from updating.diagnosis.explanation import Z95, Explanation, explained
from updating.diagnosis.held_out import LeftOut, left_out
from updating.diagnosis.search import Search
from updating.fitting.estimate import ParameterEstimate

_JUDGED = 16  # explanations whose errors on what is left out are computed
_NONE = LeftOut(frequency=float("nan"), damping=float("nan"), shape=float("nan"))


def rank(found: Search, named: Sequence[Explanation] = ()) -> tuple[Ranked, ...]:
    """Rank explanations by posterior probability; what is left out is judged for the first and for those named."""
    every = sorted(found.explanations, key=lambda x: -found.odds(x))
    odds = np.array([found.odds(x) for x in every])
    probability = np.exp(odds - odds.max())
    probability /= probability.sum()
    judged = {*every[:_JUDGED], found.base, *found.asked, *named}
    return tuple(
        ranked(found, x, float(chance), judged=x in judged)
        for x, chance in zip(every, probability, strict=True)
    )


def ranked(found: Search, own: Explanation, probability: float, *, judged: bool) -> Ranked:
    """Return what is said of one explanation; its errors on what is left out only where it is judged."""
    mode, configuration = (
        left_out(found.evidence, own, by) if judged else _NONE for by in ("mode", "configuration")
    )
    return Ranked(
        effects=own.effects,
        explained=explained(found.base, own),
        log_odds=found.odds(own),
        probability=probability,
        parameter=(*_estimates(own), *_misstated(found, own)),
        frequency_error=own.residual.frequency_error,
        damping_error=own.residual.damping_error,
        left_out_error=mode.frequency,
        left_out_damping_error=mode.damping,
        left_out_shape_error=mode.shape,
        left_out_configuration_error=configuration.frequency,
        left_out_configuration_damping_error=configuration.damping,
        misfit=own.misfit,
        n_residual=own.residual.value.size,
        discrepancy=own.mean,
    )


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


def _misstated(found: Search, own: Explanation) -> tuple[ParameterEstimate, ...]:
    """Return what hypotheses about the measurement say: factors on what was stated, or places in m."""
    evidence, estimates = found.evidence, []
    for name in own.effects:
        for nuisance in evidence.hypotheses.get(name, ()):
            i = evidence.nuisances.index(nuisance)
            unit = evidence.unit(nuisance)
            ends = own.nuisance[i] + Z95 * own.nuisance_std[i] * np.array([0.0, -1.0, 1.0])
            value, lower, upper = (ends if unit != "1" else np.exp(ends)).tolist()
            estimates.append(
                ParameterEstimate(
                    name=nuisance, unit=unit, value=value, lower=lower, upper=upper, at_bound=False
                )
            )
    return tuple(estimates)
