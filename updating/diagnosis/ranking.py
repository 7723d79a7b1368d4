"""The answer of a search: explanations in the order of their probability, and what data say of all other effects."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from model import Effect, Parameter
from updating.diagnosis.answer import (
    EXCLUDED,
    FAR,
    VISIBLE,
    Diagnosis,
    ModeError,
    Moved,
    Pulled,
    Ranked,
    SensorGain,
    Sizes,
    confounded_in,
    overstated_in,
)
from updating.diagnosis.fit_settings import coordinate_of, scaled
from updating.fitting.fit import ParameterEstimate
from updating.inference import discrepancy
from updating.inference.decide import Decision
from updating.inference.discrepancy import STIFFNESS, joined, whitened
from updating.inference.explain import Explanation, coordinates_of, errors_at
from updating.inference.protocol import LocalModel, Model, Term
from updating.inference.search import Search
from updating.inference.spread import information, rise
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
        _ranked(
            model, search, x, float(chance), judged=id(x) in judged, sizes=sizes, most=most, compared=compared_by(first)
        )
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
    compared: NDArray[np.bool_],
) -> Ranked:
    """Return what is said of one explanation; its errors on what is left out only where it is judged.

    Its errors are those of the modes `compared`.
    """
    nan = float("nan")
    if judged:
        seen = search.prediction(explanation)
        left = (seen.mode.frequency, seen.mode.damping, seen.state.frequency, seen.state.damping)
    else:
        left = (nan, nan, nan, nan)
    frequency, damping = log_ratios(explanation, compared)
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
        pulled=pulled(explanation),
    )


def sizes_of(search: Search, explanation: Explanation) -> tuple[Sizes, Sizes]:
    """Return what an explanation leaves of a frequency and of a damping ratio, and how well its logarithm is known."""
    middle, spread = explanation.evidence.moments(search.setting.priors)
    damped = explanation.problem.damping.size > 0
    return (
        Sizes(frequency=middle.stiffness / float(np.sqrt(2.0)), damping=middle.damping if damped else float("nan")),
        Sizes(frequency=spread.stiffness, damping=spread.damping),
    )


def compared_by(explanation: Explanation) -> NDArray[np.bool_]:
    """Return which measured modes an explanation takes for the model's, state by state."""
    numbered = [(c, r) for c, e in enumerate(explanation.errors) for r in range(len(e.value))]
    return np.array([mode not in explanation.apart for mode in numbered])


def log_ratios(explanation: Explanation, compared: NDArray[np.bool_] | None = None) -> tuple[Vector, Vector]:
    """Return logarithms of measured over modelled frequencies and damping ratios of the modes `compared`, by state.

    By default these are the modes that the explanation takes for the model's.
    """
    compared = compared_by(explanation) if compared is None else compared
    frequency = np.concatenate([e.paired for e in explanation.errors])
    damping = np.concatenate([e.damping for e in explanation.errors])
    return frequency[compared], damping[compared & np.isfinite(damping)]


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


@dataclass(frozen=True, kw_only=True)
class Visible:
    """What data say of a single parameter beside an explanation.

    Attributes
    ----------
    estimate, std : float
        Coordinate and its standard deviation by a linear step, all that is fitted beside it.
    reach : float
        Standard deviations by which the data would change at the farther end of its range.
    excluded : bool
        Whether the data contradict the usual strength of an effect of this one parameter, to either side of neutral.
    """

    estimate: float
    std: float
    reach: float
    excluded: bool = False


def visibility(
    model: Explained, search: Search, explanation: Explanation, among: Collection[str] | None = None
) -> dict[str, dict[str, Visible]]:
    """Return what the data say of the parameters of all effects that an explanation lacks, each beside it alone.

    To first order, but what a linear step calls excluded or visible of an effect of one parameter is asked of the
    model at that strength, for many effects saturate.

    Parameters
    ----------
    model, search, explanation
        The model, the search, and the explanation.
    among : collection of str, optional
        Effects of which this is asked; by default all.
    """
    terms = [model.terms[n] for n in explanation.terms]
    further = [model.terms[n] for n in model.effects if n not in explanation.terms and (among is None or n in among)]
    if not further:
        return {}
    coordinates = coordinates_of(model, [*terms, *further])
    have = {c.name: x for c, x in zip(explanation.coordinates, explanation.x, strict=True)}
    point = np.array([have.get(c.name, 0.0) for c in coordinates])
    local = model.about(coordinates, [point])
    seen: dict[str, dict[str, Visible]] = {}
    placed = [
        t for t in further if any(len(c.starts) > 2 and c.name not in have for c in t.coordinates)
    ]  # what they do depends on where they are
    asked, near = further, local
    for shift in range(max((len(c.starts) for t in placed for c in t.coordinates), default=1)):
        if shift == 1:
            asked, coordinates = placed, coordinates_of(model, [*terms, *placed])
            near = local.of(coordinates)
        at = np.array([have.get(c.name, 0.0) for c in coordinates])
        for i, c in enumerate(coordinates):
            if c.name not in have and len(c.starts) > 2:
                at[i] = c.starts[shift % len(c.starts)]
        problem = joined(
            errors_at(model, near, replace(search.setting, apart=explanation.apart), at), search.setting.common
        )
        mean, std = information(
            problem, at, coordinates, explanation.evidence.sizes, [c.name in have for c in coordinates]
        )
        index = {c.name: i for i, c in enumerate(coordinates)}
        for term in asked:
            for c in term.coordinates:
                i = index[c.name]
                reach = max(abs(c.lower), abs(c.upper)) / float(std[i])
                new = Visible(estimate=float(mean[i]), std=float(std[i]), reach=reach)
                old = seen.setdefault(term.name, {}).get(c.name)
                if old is None or new.std < old.std:
                    seen[term.name][c.name] = new
    here = _left(model, search, explanation, local.of(explanation.coordinates))
    for term in further:
        if len(term.coordinates) == 1:
            (name,) = seen[term.name]
            seen[term.name][name] = _asked(model, search, explanation, local, term, seen[term.name][name], here)
    return seen


def _left(
    model: Explained,
    search: Search,
    explanation: Explanation,
    local: LocalModel,
    further: tuple[Term, float] | None = None,
) -> float:
    """Return the misfit with a further term at a value of its coordinate, all else fitted.

    `local` has the coordinates of the explanation, and of the further term, alone.
    """
    more = [] if further is None else [further[0]]
    coordinates = coordinates_of(model, [*(model.terms[n] for n in explanation.terms), *more])
    have = {c.name: x for c, x in zip(explanation.coordinates, explanation.x, strict=True)}
    at = {**have, **({} if further is None else {further[0].coordinates[0].name: further[1]})}
    x = np.array([at[c.name] for c in coordinates])
    try:
        problem = joined(
            errors_at(model, local, replace(search.setting, apart=explanation.apart), x), search.setting.common
        )
    except (np.linalg.LinAlgError, ValueError):  # the model has no modes there
        return np.inf
    return rise(problem, x, coordinates, explanation.evidence.sizes, [c.name in have for c in coordinates])


def _asked(
    model: Explained,
    search: Search,
    explanation: Explanation,
    local: LocalModel,
    term: Term,
    first: Visible,
    here: float,
) -> Visible:
    """Return the same by the model at the usual strength and at the ends of the range, where first order shows any.

    `here` is the misfit without the term.
    """
    (p,), (c,) = model.effects[term.name].parameters, term.coordinates
    near = cache(lambda: local.of(coordinates_of(model, [*(model.terms[n] for n in explanation.terms), term])))

    def left(value: float) -> float:
        return _left(model, search, explanation, near(), (term, value))

    nominal = coordinate_of(p, p.nominal)
    sides = (nominal, -nominal) if p.lower < p.neutral < p.upper else (nominal,)
    if all(abs(side - first.estimate) > EXCLUDED * first.std for side in sides) and all(
        left(side) - here > EXCLUDED**2 for side in sides
    ):
        return replace(first, excluded=True)
    if first.reach < VISIBLE:
        return first
    most = max(left(float(end)) - here for end in (c.lower, c.upper) if end != 0.0)
    return replace(first, reach=float(np.sqrt(np.clip(most, 0.0, first.reach**2))))


def ruled_out(seen: Mapping[str, Mapping[str, Visible]]) -> tuple[str, ...]:
    """Return the effects of one parameter whose usual strength the data contradict."""
    return tuple(sorted(name for name, of in seen.items() if any(visible.excluded for visible in of.values())))


def not_visible(seen: Mapping[str, Mapping[str, Visible]]) -> tuple[str, ...]:
    """Return the effects that would not show at either end of the range of any of their parameters."""
    return tuple(
        sorted(name for name, of in seen.items() if max((v.reach for v in of.values()), default=0.0) < VISIBLE)
    )


_LOG = logging.getLogger(__name__)


def answer_of(model: Explained, search: Search, decision: Decision, asked: Sequence[Sequence[str]] = ()) -> Diagnosis:
    """Return what is said of any model; what is of a stack alone, and the sentences, are left out.

    Parameters
    ----------
    model : Explained
        The model.
    search : Search
        All that was fitted.
    decision : Decision
        The verdict on that.
    asked : sequence of sequence of str
        Explanations that are predicted in full in any case.
    """
    most_shown = 8  # single effects whose changes are listed mode by mode
    _LOG.info("weigh %d explanations", len(search.fitted))
    base, left = search.base, decision.left
    first = left[0] if left else base
    asked_for = [x for x in search.fitted.values() if set(x.terms) in [set(names) for names in asked]]
    ranking = rank(model, search, first, (*decision.steps, *left, *asked_for))
    of = {ranked.effects: ranked for ranked in ranking}
    seen = visibility(model, search, first)
    excluded = list(ruled_out(seen))
    for x in left[1:]:
        excluded = list(ruled_out(visibility(model, search, x, excluded)))
    if decision.verdict == "unlike anything":
        excluded = []
    shown = {*excluded, *(name for x in left for name in x.terms)}  # perhaps only beside what was identified
    far, used = pulled(first), compared_by(first)
    overstated = overstated_in(of[first.terms], model.effects)
    middle, spread = sizes_of(search, first)
    singles = sorted((x for x in search.fitted.values() if len(x.terms) == 1), key=search.odds, reverse=True)
    return Diagnosis(
        stack=None,
        verdict=decision.verdict,
        set=tuple(x.terms for x in left),
        labels={**model.labels, **overstated},
        measurement=(*model.hypotheses, *overstated),
        confounded=confounded_in(set(first.terms) - set(overstated), model.effects),
        explained=of[first.terms].explained,
        steps=tuple(of[x.terms] for x in decision.steps),
        discrepancy=middle,
        discrepancy_spread=spread,
        too_large=decision.too_large,
        unlisted=decision.unlisted,
        mixed_up=(),
        pulled=far,
        moved=model.moved(first),
        relieved=tuple(nuisance for nuisance in pulled(base) if nuisance.name not in {s.name for s in far}),
        point_change=None,
        ranking=ranking,
        errors=_errors(model, base, left, used),
        n_used={
            state.name: (state.frequency.size - sum(d == c for d, _ in first.apart), state.frequency.size)
            for c, state in enumerate(model.states)
        },
        signatures={
            x.terms[0]: tuple((log_ratios(base, used)[0] - log_ratios(x, used)[0]).tolist())
            for x in singles[:most_shown]
        },
        ruled_out=tuple(excluded),
        not_visible=tuple(name for name in not_visible(seen) if name not in shown),
        lacking=_lacking(model, first, search.setting.unseen),
        unseen=_unseen(model, first, search.setting.unseen),
        impossible={},
        sensor_gains=sensor_gains(first),
        next_tests=(),
        second_level=None,
        contact=(),
        rig=(),
        sentences=(),
    )


def _unseen(model: Explained, explanation: Explanation, unseen: Collection[tuple[int, int]]) -> tuple[str, ...]:
    """Return the measured modes that are set apart and may be modes of the model that the sensors do not see."""
    return tuple(
        f"{model.states[c].name}, mode {r + 1} at {model.states[c].frequency[r]:.1f} Hz"
        for c, r in sorted(explanation.apart.intersection(unseen))
    )


def _lacking(model: Explained, explanation: Explanation, unseen: Collection[tuple[int, int]]) -> tuple[str, ...]:
    """Return the measured modes that are none of the model's, or farther off than any model leaves them."""
    return tuple(
        f"{state.name}, mode {r + 1} at {state.frequency[r]:.1f} Hz"
        for c, (state, e) in enumerate(zip(model.states, explanation.errors, strict=True))
        for r in range(state.frequency.size)
        if ((c, r) in explanation.apart or abs(e.frequency[r]) > STIFFNESS.highest)
        and (c, r) not in explanation.apart.intersection(unseen)
    )


def _errors(
    model: Explained, base: Explanation, left: Sequence[Explanation], used: NDArray[np.bool_]
) -> tuple[ModeError, ...]:
    """List the modes used with the frequency errors of the base model and of the first explanation that is left."""
    before = np.expm1(-log_ratios(base, used)[0])
    after = np.expm1(-log_ratios(left[0], used)[0]) if left else np.full(before.size, np.nan)
    numbered = [(state, r) for state in model.states for r in range(state.frequency.size)]
    return tuple(
        ModeError(
            configuration=state.name,
            mode=r + 1,
            frequency=float(state.frequency[r]),
            std=float(state.frequency_std[r]),
            base=float(b),
            explained=float(a),
        )
        for (state, r), b, a in zip(itertools.compress(numbered, used), before, after, strict=True)
    )
