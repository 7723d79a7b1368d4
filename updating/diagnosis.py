"""Which physical effect is missing, how sure that is, what cannot be told apart, and what cannot be seen.

The base model is fitted first. Each effect and each pair is then scored by what its signature explains of the residual
after the nuisances' share is taken out; the best are fitted in full and compared by misfit and by evidence. What the
data cannot tell apart is reported as a set.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from scipy.stats import chi2

from model import Effect, Stack
from updating.candidates import candidate_model, instruments_of
from updating.coordinates import bounds_of
from updating.errors import FitError
from updating.evidence import Campaigned, Evidence, Scatter, gather
from updating.experiment import NextTest, aids, rank_tests
from updating.explanation import Explanation, explain
from updating.residual import residual

Vector = NDArray[np.float64]
Verdict = Literal["nothing missing", "identified", "one of", "unlike anything"]

SEPARATE = 3.0
"""Discrimination distance below which two explanations are an ambiguity, and an effect is not visible."""
GAIN_SINGLE = 16.0
"""Fall of the squared misfit that a missing effect must bring; the best of the whole catalogue reaches it by chance in
few of 100 complete models."""
GAIN_SECOND = 16.0
"""The same for a second effect beside the first."""
P_ADEQUATE = 1e-3
"""A model whose frequencies and damping fit worse than this is not adequate."""
N_REFIT, N_REFIT_PAIR = 12, 10
_SILENT = 1e-9  # relative length of a change that is none
_SHAPES = 6  # values tried of a parameter that shapes an effect but has no strength of its own


@dataclass(frozen=True, eq=False, kw_only=True)
class Signature:
    """What an effect does to the data, with the nuisances' share taken out.

    Attributes
    ----------
    effect : str
        Its name.
    coordinate : (n_parameter,) float
        Effect parameters at which it was taken, in units of their ranges, with 0 for strengths.
    column : (n, n_strength) float
        Change of the whitened residual over the range of each strength, after projection.
    strength : (n_strength,) int
        Which parameters are strengths.
    gain : float
        Linear fall of the misfit that it can bring within its range.
    start : (n_parameter,) float
        Coordinates that bring it.
    reach : float
        Length of the projected change at the end of the range: below 3 it is not visible.
    """

    effect: str
    coordinate: Vector
    column: Vector
    strength: NDArray[np.intp]
    gain: float
    start: Vector
    reach: float


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
    probability : float
        Posterior probability among all that were fitted.
    parameter : tuple of ParameterEstimate
        Its parameters.
    frequency_error : float
        Mean relative frequency error, eq. (2), over the modes used.
    """

    effects: tuple[str, ...]
    score: float
    misfit: float
    probability: float
    parameter: tuple[ParameterEstimate, ...]
    frequency_error: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Diagnosis:
    """The answer.

    Attributes
    ----------
    verdict : str
        "nothing missing", "identified", "one of" or "unlike anything".
    candidates : tuple of tuple of str
        The explanations that the data cannot tell apart; one where identified, none where nothing is missing.
    p_value : float
        Probability of a misfit as large as the base model's if nothing were missing.
    block_p_value : mapping of str to float
        The same for frequencies, damping ratios and shapes alone.
    ranking : tuple of Ranked
        All that were fitted in full, the best first; the base model has no effects.
    not_visible : tuple of str
        Effects that these data would not show even at the end of their plausible range.
    impossible : mapping of str to str
        Effects that this stack cannot have, and why.
    next_tests : tuple of NextTest
        Further tests by how well they would tell the candidates apart.
    sentences : tuple of str
        The answer in plain words.
    """

    verdict: Verdict
    candidates: tuple[tuple[str, ...], ...]
    p_value: float
    block_p_value: Mapping[str, float]
    ranking: tuple[Ranked, ...]
    not_visible: tuple[str, ...]
    impossible: Mapping[str, str]
    next_tests: tuple[NextTest, ...]
    sentences: tuple[str, ...]


def diagnose(
    stack: Stack,
    tested: Sequence[Campaigned],
    effects: Mapping[str, Effect],
    *,
    scatter: Scatter | None = None,
) -> Diagnosis:
    """Say which effect of a catalogue the model of a stack lacks.

    Parameters
    ----------
    stack : Stack
        The model's stack, without effects.
    tested : sequence of (str, float, ModalModel)
        Name, pressure in Pa and identified modes of each configuration.
    effects : mapping of str to Effect
        The catalogue.
    scatter : Scatter, optional
        What separates a right model from a right measurement.

    Raises
    ------
    FitError
        No measured mode resembles one of the model.
    """
    if not tested:
        message = "nothing to diagnose: no configuration was identified"
        raise FitError(message)
    instruments = instruments_of(tested[0][2])
    candidates = candidate_model(stack, instruments, effects, aids())
    return conclude(gather(candidates, tested, scatter=scatter))


def conclude(evidence: Evidence) -> Diagnosis:
    """Say which effect is missing from evidence that has been gathered."""
    base = explain(evidence)
    found = signatures(evidence, base)
    singles = [
        explain(evidence, [s.effect], nuisance=base.nuisance, coordinate=s.start)
        for s in sorted(found, key=lambda s: -s.gain)[:N_REFIT]
        if s.gain > 1.0
    ]
    pairs = [
        explain(evidence, names, nuisance=base.nuisance, coordinate=start)
        for names, start in _best_pairs(evidence, base, found, singles)
    ]
    return _judged(evidence, base, singles, pairs, found)


def signatures(evidence: Evidence, base: Explanation) -> list[Signature]:
    """Return the signature of every effect at the fitted base model."""
    n_own = len(evidence.nuisances)
    q = np.linalg.qr(base.residual.jacobian[:, :n_own])[0]

    def projected(columns: Vector) -> Vector:
        return np.asarray(columns - q @ (q.T @ columns))

    names = list(evidence.effects)
    parameters = evidence.parameters(names)
    every = residual(evidence, base.nuisance, parameters).jacobian[:, n_own:]
    column = dict(zip([p.name for p in parameters], projected(every).T, strict=True))
    r = projected(base.residual.value)
    size = float(np.abs(every).max())
    found = []
    for name in names:
        own = evidence.parameters([name])
        columns = np.column_stack([column[p.name] for p in own])
        raw = every[:, [parameters.index(p) for p in own]]
        strength = np.flatnonzero(np.linalg.norm(raw, axis=0) > _SILENT * size)
        shaping = [i for i in range(len(own)) if i not in strength]
        if not shaping:
            found.append(_signature(name, np.zeros(len(own)), columns, strength, r, own))
            continue
        low, high = bounds_of(own)
        trials = []
        for values in itertools.product(*(np.linspace(low[i], high[i], _SHAPES) for i in shaping)):
            at = np.zeros(len(own))
            at[shaping] = values
            slope = projected(residual(evidence, base.nuisance, own, at).jacobian[:, n_own:])
            strong = np.flatnonzero(np.linalg.norm(slope, axis=0) > _SILENT * size)
            trials.append(_signature(name, at, slope, np.setdiff1d(strong, shaping), r, own))
        found.append(max(trials, key=lambda s: s.gain))
    return found


def _signature(
    name: str, at: Vector, columns: Vector, strength: NDArray[np.intp], r: Vector, own: Sequence[object]
) -> Signature:
    low, high = bounds_of(own)  # type: ignore[arg-type]
    c = columns[:, strength]
    step = _bounded(c, r, low[strength], high[strength])
    start = at.copy()
    start[strength] = step
    reach = max(
        (float(np.linalg.norm(c[:, i]) * max(abs(low[s]), abs(high[s]))) for i, s in enumerate(strength)),
        default=0.0,
    )
    return Signature(
        effect=name,
        coordinate=at,
        column=c,
        strength=strength,
        gain=float(r @ r - np.sum((r + c @ step) ** 2)),
        start=start,
        reach=reach,
    )


def _bounded(c: Vector, r: Vector, low: Vector, high: Vector) -> Vector:
    """Return the step within bounds that makes r + c step smallest."""
    gram = c.T @ c
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-30))
    if not scale.size or scale.max() < 1e-12:
        return np.zeros(scale.size)
    small = gram / np.outer(scale, scale) + 1e-10 * np.eye(scale.size)
    root = np.linalg.cholesky(small)
    target = np.linalg.solve(root, -(c.T @ r) / scale)
    solution = lsq_linear(root.T, target, bounds=(low * scale - 1e-12, high * scale + 1e-12))
    return np.asarray(solution.x / scale)


def _best_pairs(
    evidence: Evidence, base: Explanation, found: Sequence[Signature], singles: Sequence[Explanation]
) -> list[tuple[tuple[str, str], Vector]]:
    """Return the pairs that explain most by a linear step, with where to start them."""
    visible = [s for s in found if s.reach >= SEPARATE and s.gain >= 0.0]
    fitted = {x.effects[0]: x for x in singles}
    q = np.linalg.qr(base.residual.jacobian[:, : len(evidence.nuisances)])[0]
    r = base.residual.value - q @ (q.T @ base.residual.value)
    scored = []
    for a, b in itertools.combinations(visible, 2):
        own = (evidence.parameters([a.effect]), evidence.parameters([b.effect]))
        if {p.name for p in own[0]} & {p.name for p in own[1]}:
            continue
        bounds = [bounds_of(p) for p in own]
        low = np.concatenate([bounds[0][0][a.strength], bounds[1][0][b.strength]])
        high = np.concatenate([bounds[0][1][a.strength], bounds[1][1][b.strength]])
        c = np.hstack([a.column, b.column])
        step = _bounded(c, r, low, high)
        first, second = a.coordinate.copy(), b.coordinate.copy()
        first[a.strength], second[b.strength] = step[: a.strength.size], step[a.strength.size :]
        scored.append(
            (float(np.sum((r + c @ step) ** 2)), (a.effect, b.effect), np.concatenate([first, second]))
        )
    scored.sort(key=lambda item: item[0])
    chosen = {names: start for _, names, start in scored[:N_REFIT_PAIR]}
    if singles:  # beside the best single effect, whose full fit tells more than its first step
        best = min(singles, key=lambda x: x.misfit).effects[0]
        beside = [item for item in scored if best in item[1]][: N_REFIT_PAIR // 2]
        for _, names, start in beside:
            n_first = len(evidence.parameters([names[0]]))
            full = start.copy()
            own_part = slice(None, n_first) if names[0] == best else slice(n_first, None)
            full[own_part] = fitted[best].coordinate
            chosen[names] = full
    return list(chosen.items())


def _block_p(explanation: Explanation, kinds: Sequence[str], n_free: int) -> float:
    """Return the probability of a misfit as large in some kinds of data."""
    inside = np.isin(explanation.residual.kind, kinds)
    misfit = float(np.sum(explanation.residual.value[inside] ** 2))
    return float(chi2.sf(misfit, max(int(inside.sum()) - n_free, 1)))


def _adequacy(evidence: Evidence, explanation: Explanation) -> float:
    """Return the smaller of the p-values of frequencies with damping and priors, and of shapes, times two."""
    n_free = len(evidence.nuisances) + len(explanation.parameter)
    modal = _block_p(explanation, ["frequency", "damping", "prior"], n_free)
    shape = _block_p(explanation, ["shape"], 0)
    return min(1.0, 2.0 * min(modal, shape))


def _judged(
    evidence: Evidence,
    base: Explanation,
    singles: Sequence[Explanation],
    pairs: Sequence[Explanation],
    found: Sequence[Signature],
) -> Diagnosis:
    from updating.diagnosis_text import sentences  # here: the text is written of the diagnosis's own parts

    p_value = _adequacy(evidence, base)
    single = min(singles, key=lambda x: x.misfit, default=base)
    pair = min(pairs, key=lambda x: x.misfit, default=base)
    needed = base.misfit - single.misfit > GAIN_SINGLE
    second = single.misfit - pair.misfit > GAIN_SECOND and _adequacy(evidence, single) < P_ADEQUATE * 50.0
    if not needed and base.misfit - pair.misfit > GAIN_SINGLE + GAIN_SECOND:
        needed = second = True
    left: list[Explanation] = []
    verdict: Verdict
    if not needed:
        verdict = "nothing missing" if p_value > P_ADEQUATE else "unlike anything"
    else:
        best, among = (pair, pairs) if second else (single, singles)
        left = sorted((x for x in among if x.misfit - best.misfit < SEPARATE**2), key=lambda x: x.misfit)
        if _adequacy(evidence, best) < P_ADEQUATE:
            verdict, left = "unlike anything", []
        else:
            verdict = "identified" if len(left) == 1 else "one of"
    tests = rank_tests(evidence, left[:4])
    ranking = _ranking(evidence, base, (*singles, *pairs))
    not_visible = tuple(sorted(s.effect for s in found if s.reach < SEPARATE))
    blocks = {kind: _block_p(base, [kind], 0) for kind in ("frequency", "damping", "shape")}
    candidates = tuple(x.effects for x in left)
    return Diagnosis(
        verdict=verdict,
        candidates=candidates,
        p_value=p_value,
        block_p_value=blocks,
        ranking=ranking,
        not_visible=not_visible,
        impossible=evidence.impossible,
        next_tests=tests,
        sentences=sentences(verdict, p_value, base, left, ranking, not_visible, tests),
    )


def _ranking(evidence: Evidence, base: Explanation, fitted: Sequence[Explanation]) -> tuple[Ranked, ...]:
    """Rank explanations by posterior probability: none, one or two effects have 1/2, 2/5 and 1/10 beforehand."""
    n = len(evidence.effects)
    weight = (np.log(0.5), np.log(0.4 / n), np.log(0.1 / (n * (n - 1) / 2.0)))
    every = (base, *fitted)
    score = np.array([weight[len(x.effects)] + x.log_evidence for x in every])
    probability = np.exp(score - score.max())
    probability /= probability.sum()
    expected = base.residual.value.size - len(evidence.nuisances)
    excess = max(base.misfit - min(expected, base.misfit * 0.5), 1e-12)
    ranked = [
        Ranked(
            effects=x.effects,
            score=float(np.clip((base.misfit - x.misfit) / excess, 0.0, 1.0)),
            misfit=x.misfit,
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
            frequency_error=frequency_error_of(evidence, x),
        )
        for x, chance in zip(every, probability, strict=True)
    ]
    return tuple(sorted(ranked, key=lambda x: -x.probability))


def frequency_error_of(evidence: Evidence, explanation: Explanation) -> float:
    """Return the mean relative frequency error, eq. (2), over the modes used."""
    error, at = [], 0
    inside = explanation.residual.value[explanation.residual.kind == "frequency"]
    for tested, used in zip(evidence.tested, evidence.used, strict=True):
        std = np.hypot(
            tested.modes.frequency_std[used] / tested.modes.frequency[used], evidence.scatter.frequency
        )
        error.append(np.abs(1.0 - np.exp(-inside[at : at + used.size] * std)))
        at += used.size
    return float(np.mean(np.concatenate(error)))
