"""Which physical effect is missing, how sure that is, what cannot be told apart, and what cannot be seen.

The base model is fitted first. Each effect and each pair is then scored by what its signature explains of the residual
after the nuisances' share is taken out; the best are fitted in full and compared by misfit and by evidence. What the
data cannot tell apart is reported as a set.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from model import Effect, Stack
from updating.candidates import candidate_model, instruments_of
from updating.diagnosis_text import sentences
from updating.errors import FitError
from updating.evidence import Campaigned, Evidence, Scatter, gather
from updating.experiment import NextTest, aids, rank_tests
from updating.explanation import Explanation
from updating.search import VISIBLE, Search, search

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
WORTH = 4.0
"""Fall of the squared misfit below which an effect is not worth a fit."""


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
    found = search(evidence, WORTH)
    return judged(found)


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


def judged(found: Search) -> Diagnosis:
    """Give the verdict on what a search found."""
    evidence, base, singles, pairs = found.evidence, found.base, found.singles, found.pairs
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
    not_visible = tuple(sorted(s.effect for s in found.screened if s.reach < VISIBLE))
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
