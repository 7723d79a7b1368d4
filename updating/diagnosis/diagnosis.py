"""Which physical effect is missing, how sure that is, what cannot be told apart, and what cannot be seen.

The base model is fitted first. Each effect is then scored by what its signature explains of the residual after the
nuisances' share is taken out; the best are fitted in full, alone and together, and compared by evidence, the size of
the discrepancy that every model has being integrated out. What the data cannot tell apart is reported as a set.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.types.threads import single_threaded
from model import Effect, Stack
from updating.correlation.pairing import require_points
from updating.diagnosis.assembly import Assembled, Campaigned, assemble_evidence
from updating.diagnosis.candidates import CandidateModel, candidate_model, instruments_of
from updating.diagnosis.discrepancy import Sizes
from updating.diagnosis.evidence import DiagnosisScatter, Evidence, Tested
from updating.diagnosis.exclusion import ruled_out
from updating.diagnosis.experiment import NextTest, aids, rank_tests
from updating.diagnosis.explanation import Explanation
from updating.diagnosis.held_out import left_out
from updating.diagnosis.hypotheses import LABELS
from updating.diagnosis.point_change import PointChange
from updating.diagnosis.ranking import Ranked, explained, rank
from updating.diagnosis.search import VISIBLE, Search, search
from updating.diagnosis.sensor_gain import SensorGain, sensor_gains
from updating.diagnosis.text import sentences
from updating.diagnosis.verdict import Verdict, decide
from updating.errors import FitError

Vector = NDArray[np.float64]
_LOG = logging.getLogger(__name__)

_SHOWN = 8  # single effects whose changes are told mode by mode
_COMPARED = 4  # explanations between which further tests are to tell


@dataclass(frozen=True, kw_only=True)
class ModeError:
    """A measured mode and how far the model's frequency is from it.

    Attributes
    ----------
    configuration : str
        Of the campaign.
    mode : int
        Its number there, from 1.
    frequency, std : float
        Measured, with its standard deviation, Hz.
    base, explained : float
        Relative error of the model's frequency without effects and with the first candidate; NaN without one.
    """

    configuration: str
    mode: int
    frequency: float
    std: float
    base: float
    explained: float


@dataclass(frozen=True, kw_only=True)
class Step:
    """The model with one effect more.

    Attributes
    ----------
    effects : tuple of str
        Those that it has; none at first.
    explained : float
        Share of the base model's misfit that it explains.
    frequency_error, left_out_error : float
        Mean relative error of frequencies, of the modes that were fitted and of each mode predicted from all others.
    discrepancy : Sizes
        What it leaves beside the noise of the measurement.
    """

    effects: tuple[str, ...]
    explained: float
    frequency_error: float
    left_out_error: float
    discrepancy: Sizes


@dataclass(frozen=True, eq=False, kw_only=True)
class Diagnosis:
    """The answer.

    Attributes
    ----------
    verdict : str
        "nothing missing", "identified", "one of", "partly explained" or "unlike anything".
    set : tuple of tuple of str
        The explanations that the data cannot tell apart; one where identified, none where nothing is missing.
    labels : mapping of str to str
        What a person calls each effect of the ranking.
    explained : float
        Share of the misfit that the first of the set explains.
    steps : tuple of Step
        From the base model to the first of the set, one effect at a time.
    discrepancy, discrepancy_spread : Sizes
        What the first of the set, or the base model, leaves beside the noise; standard deviations of the logarithms.
    point_change : PointChange, optional
        What is left looks like this.
    ranking : tuple of Ranked
        All that were fitted in full, the best first; the base model has no effects.
    errors : tuple of ModeError
        The modes that were used.
    n_used : mapping of str to (int, int)
        How many modes of each configuration the answer rests on, and how many were identified.
    signatures : mapping of str to (n,) float
        Relative change of the frequencies of `errors` by the best single effects, each fitted alone.
    ruled_out : tuple of str
        Effects whose usual strength these data exclude beside every explanation that is left.
    not_visible : tuple of str
        Effects that these data would not show even at the end of their plausible range.
    lacking : tuple of str
        Measured modes that the model lacks amid those that it has.
    impossible : mapping of str to str
        Effects that this stack cannot have, and why.
    sensor_gains : tuple of SensorGain
        Of roving accelerometers beside the first, with the first explanation that is left, or the base model.
    next_tests : tuple of NextTest
        Further tests by how well they would tell the candidates apart.
    sentences : tuple of str
        The answer in plain words.
    """

    verdict: Verdict
    set: tuple[tuple[str, ...], ...]
    labels: Mapping[str, str]
    explained: float
    steps: tuple[Step, ...]
    discrepancy: Sizes
    discrepancy_spread: Sizes
    point_change: PointChange | None
    ranking: tuple[Ranked, ...]
    errors: tuple[ModeError, ...]
    n_used: Mapping[str, tuple[int, int]]
    signatures: Mapping[str, tuple[float, ...]]
    ruled_out: tuple[str, ...]
    not_visible: tuple[str, ...]
    lacking: tuple[str, ...]
    impossible: Mapping[str, str]
    sensor_gains: tuple[SensorGain, ...]
    next_tests: tuple[NextTest, ...]
    sentences: tuple[str, ...]


@single_threaded
def diagnose(
    stack: Stack,
    tested: Sequence[Campaigned],
    effects: Mapping[str, Effect],
    *,
    scatter: DiagnosisScatter | None = None,
    executor: Executor | None = None,
    reduced: Callable[..., CandidateModel] = candidate_model,
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
    scatter : DiagnosisScatter, optional
        What a laboratory knows of what separates a right model from a right measurement.
    executor : Executor, optional
        What takes a part of the work, such as `workers`; by default this process does it all.
    reduced : callable
        `candidate_model`, or `cached_model`, which caches the model for the next diagnosis of the same stack.

    Raises
    ------
    FitError
        No measured mode resembles one of the model.
    PairingError
        Measured points do not lie on the stack, or are fewer than the modes.
    """
    if not tested:
        message = "nothing to diagnose: no configuration was identified"
        raise FitError(message)
    for _, _, modes in tested:
        require_points(modes)
    candidates = reduced(stack, instruments_of(tested[0][2]), effects, aids(), executor)
    return conclude(assemble_evidence(candidates, tested, scatter=scatter), executor)


def conclude(evidence: Assembled, executor: Executor | None = None) -> Diagnosis:
    """Say which effect is missing from evidence that has been assembled."""
    found = search(evidence, executor)
    _LOG.info("weigh %d explanations", len(found.explanations))
    decision = decide(found)
    base, left = found.base, decision.left
    first = left[0] if left else base
    ranking = rank(found)
    named = {name for x in left for name in x.effects}
    answer: dict[str, Any] = {
        "steps": tuple(_step(found, x) for x in decision.steps),
        "labels": _labels(found),
        "discrepancy": first.mean,
        "discrepancy_spread": first.spread,
        "ranking": ranking,
        "n_used": {
            t.name: (int(used.size), int(t.modes.frequency.size))
            for t, used in zip(found.evidence.tested, found.evidence.used, strict=True)
        },
        "ruled_out": ruled_out(found, decision),
        "not_visible": tuple(
            sorted(s.effect for s in found.screened if s.detectability < VISIBLE and s.effect not in named)
        ),
        "lacking": tuple(_labelled(found.evidence.tested[c], r) for c, r in found.evidence.lacking),
        "sensor_gains": sensor_gains(found.evidence, first),
        "next_tests": rank_tests(found.evidence, left[:_COMPARED]),
    }
    return Diagnosis(
        verdict=decision.verdict,
        set=tuple(x.effects for x in left),
        explained=explained(base, first),
        point_change=decision.point,
        errors=_errors(found.evidence, base, left),
        signatures={
            x.effects[0]: tuple((base.residual.log_frequency - x.residual.log_frequency).tolist())
            for x in found.singles[:_SHOWN]
        },
        impossible=evidence.impossible,
        sentences=sentences(found, decision, answer),
        **answer,
    )


def _step(found: Search, own: Explanation) -> Step:
    return Step(
        effects=own.effects,
        explained=explained(found.base, own),
        frequency_error=own.residual.frequency_error,
        left_out_error=left_out(found.evidence, own.residual).frequency,
        discrepancy=own.mean,
    )


def _labelled(own: Tested, r: int) -> str:
    """Return what a measured mode is called."""
    return f"{own.name}, mode {r + 1} at {own.modes.frequency[r]:.1f} Hz"


def _errors(evidence: Evidence, base: Explanation, left: Sequence[Explanation]) -> tuple[ModeError, ...]:
    """List the modes used with the frequency errors of the base model and of the first explanation that is left."""
    before = np.expm1(-base.residual.log_frequency)
    after = np.expm1(-left[0].residual.log_frequency) if left else np.full(before.size, np.nan)
    return tuple(
        ModeError(
            configuration=evidence.tested[c].name,
            mode=r + 1,
            frequency=float(evidence.tested[c].modes.frequency[r]),
            std=float(evidence.tested[c].modes.frequency_std[r]),
            base=float(b),
            explained=float(a),
        )
        for (c, r), b, a in zip(evidence.modes, before, after, strict=True)
    )


def _labels(found: Search) -> dict[str, str]:
    """Return what a person calls the effects and hypotheses."""
    return {
        **{name: _label(effect) for name, effect in found.evidence.effects.items()},
        **{name: LABELS[name] for name in found.evidence.hypotheses},
    }


def _label(effect: Effect) -> str:
    return getattr(effect, "label", "") or effect.summary[:1].lower() + effect.summary[1:]
