"""Explanations in the order of their probability, as an answer lists them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from model import Effect, Parameter
from updating.diagnosis.answer import Moved, Pulled, Ranked, SensorGain, Sizes
from updating.diagnosis.calibration import FAR
from updating.diagnosis.fit_settings import scaled
from updating.fitting.fit import ParameterEstimate
from updating.inference import discrepancy
from updating.inference.discrepancy import whitened
from updating.inference.explain import Explanation
from updating.inference.protocol import Model
from updating.inference.search import Search
from updating.results.text import Z95


class Explained(Model, Protocol):
    """A model whose explanations are reported: a stack, or matrices of another program."""

    @property
    def effects(self) -> Mapping[str, Effect]:
        """Candidates for what is missing, by name."""

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """Parameters of all of them, by name."""

    @property
    def hypotheses(self) -> Mapping[str, Mapping[str, float]]:
        """What may have been stated or measured wrongly: of each, the nuisances whose prior it widens."""

    @property
    def labels(self) -> Mapping[str, str]:
        """Plain name of each effect and hypothesis."""

    def unit(self, nuisance: str) -> str:
        """Return the unit of a nuisance: m of locations, 1/s of a decay, 1 where it is the logarithm of a ratio."""

    def moved(self, explanation: Explanation) -> tuple[Moved, ...]:
        """Return every quantity that all fits may move, as stated and as an explanation was fitted with it."""


Vector = NDArray[np.float64]


def rank(model: Explained, search: Search, first: Explanation, named: Collection[Explanation]) -> tuple[Ranked, ...]:
    """Rank explanations by posterior probability; what is left out is predicted by the first and by those named.

    Parameters
    ----------
    model : Explained
        The model.
    search : Search
        All that were fitted.
    first : Explanation
        The answer: by the discrepancy that it leaves, misfits are measured.
    named : collection of Explanation
        See above.
    """
    most_judged = 16  # explanations whose errors on what is left out are computed
    by_odds = sorted(search.fitted.values(), key=lambda x: -search.odds(x))
    odds = np.array([search.odds(x) for x in by_odds])
    probability = np.exp(odds - odds.max())
    probability /= probability.sum()
    judged = {id(x) for x in (*by_odds[:most_judged], search.base, first, *named)}
    sizes = first.evidence.sizes
    most = misfit(search.base, sizes)
    return tuple(
        _ranked(model, search, x, float(chance), judged=id(x) in judged, sizes=sizes, most=most)
        for x, chance in zip(by_odds, probability, strict=True)
    )


def _ranked(
    model: Explained,
    search: Search,
    explanation: Explanation,
    probability: float,
    *,
    judged: bool,
    sizes: discrepancy.Sizes,
    most: float,
) -> Ranked:
    """Return what is said of one explanation; its errors on what is left out only where it is judged."""
    nan = float("nan")
    if judged:
        seen = search.prediction(explanation)
        left = (seen.mode.frequency, seen.mode.damping, seen.state.frequency, seen.state.damping)
    else:
        left = (nan, nan, nan, nan)
    frequency, damping = log_ratios(explanation)
    rest = misfit(explanation, sizes)
    return Ranked(
        effects=explanation.terms,
        explained=float(np.clip(1.0 - rest / most, 0.0, 1.0)),
        log_odds=search.odds(explanation),
        probability=probability,
        parameter=(*estimates(model, explanation), *_misstated(model, explanation)),
        frequency_error=mean_error(frequency),
        damping_error=mean_error(damping),
        left_out_error=left[0],
        left_out_damping_error=left[1],
        left_out_configuration_error=left[2],
        left_out_configuration_damping_error=left[3],
        misfit=rest,
        n_residual=explanation.problem.value.size + explanation.problem.damping.size,
        discrepancy=sizes_of(search, explanation)[0],
        nuisance={
            c.name: float(x)
            for c, x in zip(explanation.coordinates[: explanation.n_nuisance], explanation.x, strict=False)
        },
        modelled={
            state.name: tuple(np.sqrt(e.modelled[0][e.modelled[0] > 0.0] / (4.0 * np.pi**2)).tolist())
            for state, e in zip(model.states, explanation.errors, strict=True)
        },
        strained=pulled(explanation),
    )


def sizes_of(search: Search, explanation: Explanation) -> tuple[Sizes, Sizes]:
    """Return what an explanation leaves of a frequency and of a damping ratio, and how well its logarithm is known."""
    middle, spread = explanation.evidence.moments(search.setting.priors)
    damped = explanation.problem.damping.size > 0
    return (
        Sizes(frequency=middle.stiffness / float(np.sqrt(2.0)), damping=middle.damping if damped else float("nan")),
        Sizes(frequency=spread.stiffness, damping=spread.damping),
    )


def log_ratios(explanation: Explanation) -> tuple[Vector, Vector]:
    """Return logarithms of measured over modelled frequencies, and damping ratios that are compared, state by state."""
    damping = np.concatenate([e.damping for e in explanation.errors])
    return np.concatenate([e.paired for e in explanation.errors]), damping[np.isfinite(damping)]


def mean_error(log_ratio: Vector) -> float:
    """Return the mean relative error of the model, NaN of nothing."""
    return float(np.mean(np.abs(np.expm1(-log_ratio)))) if log_ratio.size else float("nan")


def misfit(explanation: Explanation, sizes: discrepancy.Sizes) -> float:
    """Return the squares of an explanation's errors over their variances by noise and a discrepancy of given sizes."""
    value, _, _ = whitened(explanation.problem, sizes)
    return float(value @ value + np.sum(explanation.pulls[np.isfinite([c.std for c in explanation.coordinates])] ** 2))


def pulled(explanation: Explanation) -> tuple[Pulled, ...]:
    """Return the nuisances that an explanation needs far from what is known of them; gains are reported apart."""
    return tuple(
        Pulled(name=c.name, value=float(x), std=c.std)
        for c, x in zip(explanation.coordinates[: explanation.n_nuisance], explanation.x, strict=False)
        if abs(x) > FAR * c.std and not c.name.startswith("gain")
    )


def sensor_gains(explanation: Explanation) -> tuple[SensorGain, ...]:
    """Return the gains of all roving accelerometers but the first, as an explanation was fitted with them."""
    return tuple(
        SensorGain(sensor=int(c.name[12:-1]), excess=float(np.expm1(x)), std=float(std))
        for c, x, std in zip(explanation.coordinates, explanation.x, explanation.std, strict=True)
        if c.name.startswith("gain[sensor ")
    )


def estimates(model: Explained, explanation: Explanation) -> list[ParameterEstimate]:
    """Return the parameters of an explanation's effects with their 95 % intervals."""
    rows, known = [], model.parameters
    for i in range(explanation.n_nuisance, explanation.x.size):
        c, p = explanation.coordinates[i], known[explanation.coordinates[i].name]
        ends = np.clip(explanation.x[i] + Z95 * explanation.std[i] * np.array([-1.0, 1.0]), c.lower, c.upper)
        value, lower, upper = (scaled(p, float(z))[0] for z in (explanation.x[i], *ends))
        rows.append(
            ParameterEstimate(
                name=p.name, unit=p.unit, value=value, lower=lower, upper=upper, at_bound=bool(explanation.at_bound[i])
            )
        )
    return rows


def _misstated(model: Explained, explanation: Explanation) -> list[ParameterEstimate]:
    """Return what hypotheses about the measurement say: factors on what was stated, locations in m, decays in 1/s."""
    rows = []
    names = [c.name for c in explanation.coordinates]
    for nuisance in (n for term in explanation.terms for n in model.hypotheses.get(term, ())):
        i = names.index(nuisance)
        unit = model.unit(nuisance)
        ends = explanation.x[i] + Z95 * explanation.std[i] * np.array([0.0, -1.0, 1.0])
        value, lower, upper = (ends if unit != "1" else np.exp(ends)).tolist()
        rows.append(ParameterEstimate(name=nuisance, unit=unit, value=value, lower=lower, upper=upper, at_bound=False))
    return rows
