"""Which physical effect is missing, how sure that is, what cannot be told apart, and what cannot be seen.

The base model is fitted first. Each effect and each pair is then scored by what its signature explains of the residual
after the nuisances' share is taken out; the best are fitted in full and compared by misfit and by evidence. What the
data cannot tell apart is reported as a set.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.types.threads import single_threaded
from model import Effect, Stack
from updating.correlation.pairing import require_points
from updating.diagnosis.adequacy import block_p_value, p_value
from updating.diagnosis.candidates import CandidateModel, candidate_model, instruments_of
from updating.diagnosis.chance import chance_of_gain
from updating.diagnosis.evidence import DiagnosisScatter, Evidence, Tested
from updating.diagnosis.exclusion import ruled_out
from updating.diagnosis.experiment import NextTest, aids, rank_tests
from updating.diagnosis.explanation import Explanation, best_of
from updating.diagnosis.gathering import Campaigned, Gathered, gather
from updating.diagnosis.point_change import PointChange
from updating.diagnosis.ranking import Ranked, rank
from updating.diagnosis.search import VISIBLE, search
from updating.diagnosis.sensor_gain import SensorGain, sensor_gains
from updating.diagnosis.text import sentences
from updating.diagnosis.verdict import Verdict, decide
from updating.errors import FitError

Vector = NDArray[np.float64]
_LOG = logging.getLogger(__name__)

WORTH = 4.0
"""Fall of the squared misfit below which an effect is not worth a fit."""
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Diagnosis:
    """The answer.

    Attributes
    ----------
    verdict : str
        "nothing missing", "identified", "one of" or "unlike anything".
    set : tuple of tuple of str
        The explanations that the data cannot tell apart; one where identified, none where nothing is missing.
    in_doubt : tuple of str
        A second effect beside the one that is named: it leaves less, but the form of the first may account for that.
    point_change : PointChange, optional
        Where nothing of the catalogue is like it: what is left looks like this.
    p_value : float
        Probability of a misfit as large as the base model's if nothing were missing.
    block_p_value : mapping of str to float
        The same for frequencies, damping ratios and shapes alone.
    chance : float
        Probability that the best effect alone explains as much where nothing is missing, by `chance_of_gain`.
    ranking : tuple of Ranked
        All that were fitted in full, the best first; the base model has no effects.
    errors : tuple of ModeError
        The modes that were used.
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
    in_doubt: tuple[str, ...]
    point_change: PointChange | None
    p_value: float
    block_p_value: Mapping[str, float]
    chance: float
    ranking: tuple[Ranked, ...]
    errors: tuple[ModeError, ...]
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
        What separates a right model from a right measurement.
    executor : Executor, optional
        What takes a part of the work, such as `workers`; by default this process does it all.
    reduced : callable
        `candidate_model`, or `kept_model`, which keeps the model for the next diagnosis of the same stack.

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
    return conclude(gather(candidates, tested, scatter=scatter), executor)


def conclude(evidence: Gathered, executor: Executor | None = None) -> Diagnosis:
    """Say which effect is missing from evidence that has been gathered."""
    found = search(evidence, WORTH, executor)
    _LOG.info("weigh %d explanations", len(found.explanations))
    decision = decide(found)
    base, left = found.base, decision.left
    tests = rank_tests(found.evidence, left[:_COMPARED])
    ranking = rank(found)
    chance = chance_of_gain(found.screened, base.misfit - best_of(found.singles, base).misfit)
    excluded = ruled_out(found, decision)
    not_visible = tuple(sorted(s.effect for s in found.screened if s.reach < VISIBLE))
    gains = sensor_gains(found.evidence, left[0] if left else base)
    lacking = tuple(_labelled(found.evidence.tested[c], r) for c, r in found.evidence.lacking)
    return Diagnosis(
        verdict=decision.verdict,
        set=tuple(x.effects for x in left),
        in_doubt=decision.doubt.effects if decision.doubt else (),
        point_change=decision.point,
        p_value=p_value(base),
        block_p_value={kind: block_p_value(base, kind) for kind in ("frequency", "damping", "shape")},
        chance=chance,
        ranking=ranking,
        errors=_errors(found.evidence, base, left),
        signatures={
            x.effects[0]: tuple((base.residual.log_frequency - x.residual.log_frequency).tolist())
            for x in found.singles[:_SHOWN]
        },
        ruled_out=excluded,
        not_visible=not_visible,
        lacking=lacking,
        impossible=evidence.impossible,
        sensor_gains=gains,
        next_tests=tests,
        sentences=sentences(decision, chance, base, ranking, excluded, not_visible, lacking, gains, tests),
    )


def _labelled(own: Tested, r: int) -> str:
    """Return what a measured mode is called."""
    return f"{own.name}, mode {r + 1} at {own.modes.frequency[r]:.1f} Hz"


def _errors(evidence: Evidence, base: Explanation, left: Sequence[Explanation]) -> tuple[ModeError, ...]:
    """List the modes used with the frequency errors of the base model and of the first explanation that is left."""
    modes = [(t, int(r)) for t, used in zip(evidence.tested, evidence.used, strict=True) for r in used]
    before = np.expm1(-base.residual.log_frequency)
    after = np.expm1(-left[0].residual.log_frequency) if left else np.full(before.size, np.nan)
    return tuple(
        ModeError(
            configuration=own.name,
            mode=r + 1,
            frequency=float(own.modes.frequency[r]),
            std=float(own.modes.frequency_std[r]),
            base=float(b),
            explained=float(a),
        )
        for (own, r), b, a in zip(modes, before, after, strict=True)
    )
