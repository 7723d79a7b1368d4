"""Which physical effect is missing, how sure that is, what cannot be told apart, and what cannot be seen.

The base model is fitted first, then effects and what may be wrong with the measurement, alone and together
(`updating.inference`). They are compared by evidence, the size of the discrepancy that every model has being integrated
out. What the data cannot tell apart is reported as a set.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.types.threads import single_threaded
from model import Effect, Stack
from updating.correlation.pairing import require_points
from updating.correlation.rig_check import RigCheck, check_rig, upright
from updating.diagnosis.answer import Diagnosis, ModeError, confounded_in, overstated_in
from updating.diagnosis.answer_parts import MixedUp
from updating.diagnosis.assembly import Assembled, Campaigned, assemble_evidence
from updating.diagnosis.calibration import MIXED_UP
from updating.diagnosis.candidates import G_F_RANGE, CandidateModel, candidate_model, instruments_of
from updating.diagnosis.contact_amplitude import contact_amplitudes
from updating.diagnosis.evidence import DiagnosisScatter, Evidence
from updating.diagnosis.experiment import aids, rank_tests
from updating.diagnosis.hypotheses import LABELS
from updating.diagnosis.mixed_up import MOST as MOST_MIXED
from updating.diagnosis.mixed_up import put_right
from updating.diagnosis.moved import moved
from updating.diagnosis.point_change import point_change
from updating.diagnosis.ranking import log_ratios, rank, sensor_gains, sizes_of, strained
from updating.diagnosis.second_level import second_level
from updating.diagnosis.slipping import AtLevel
from updating.diagnosis.stack_model import StackModel
from updating.diagnosis.text import sentences
from updating.diagnosis.visibility import not_visible, ruled_out, visibility
from updating.errors import FitError
from updating.inference.decide import decide
from updating.inference.discrepancy import DAMPING, STIFFNESS, SizePrior
from updating.inference.explain import Explanation, Setting, explain
from updating.inference.search import Search, begin, search

_LOG = logging.getLogger(__name__)

_SHOWN = 8  # single effects whose changes are told mode by mode
_COMPARED = 3  # explanations between which further tests are to tell
SHARES = (0.9, 0.0, 0.1)
"""Shares of the discrepancy that all states of a stack, and all force levels of one state, have in common: what a model
misses of a mode changes little with the torque."""


@single_threaded
def diagnose(
    stack: Stack,
    tested: Sequence[Campaigned],
    effects: Mapping[str, Effect],
    *,
    scatter: DiagnosisScatter | None = None,
    executor: Executor | None = None,
    reduced: Callable[..., CandidateModel] = candidate_model,
    asked: Sequence[Sequence[str]] = (),
    levels: Mapping[str, AtLevel] | None = None,
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
    asked : sequence of sequence of str
        Effects, or effects together, that are fitted and ranked in any case.
    levels : mapping of str to AtLevel, optional
        Which force level each configuration is, by its name, where some are levels of one state.

    Raises
    ------
    FitError
        No measured mode of a configuration resembles one of the model.
    PairingError
        Measured points do not lie on the stack, or are fewer than the modes, or a sensor was upside down in all runs.
    """
    if not tested:
        message = "nothing to diagnose: no configuration was identified"
        raise FitError(message)
    for _, _, modes in tested:
        require_points(modes)
    candidates = reduced(stack, instruments_of(tested[0][2]), effects, aids(), executor)
    rig = tuple(
        upright(check_rig(candidates.system, pressure, modes, G_F_RANGE)) for _, pressure, modes in tested
    )
    evidence = assemble_evidence(candidates, tested, scatter=scatter, levels=levels)
    return conclude(candidates, evidence, asked, rig)


def conclude(
    candidates: CandidateModel,
    evidence: Assembled,
    asked: Sequence[Sequence[str]] = (),
    rig: tuple[RigCheck, ...] = (),
) -> Diagnosis:
    """Say which effect is missing from evidence that has been assembled; see `diagnose`.

    `rig` is what was checked of force, scale and sensors of each configuration.
    """
    model, found, mixed_up = searched(candidates, evidence, asked)
    _LOG.info("weigh %d explanations", len(found.fitted))
    decision = decide(found)
    base, left = found.base, decision.left
    first = left[0] if left else base
    every = [x for x in found.fitted.values() if set(x.terms) in [set(names) for names in asked]]
    ranking = rank(model, found, first, (*decision.steps, *left, *every))
    of = {own.effects: own for own in ranking}
    seen = visibility(model, found, first)
    excluded = list(ruled_out(seen))
    for x in left[1:]:
        excluded = list(ruled_out(visibility(model, found, x, excluded)))
    if decision.verdict == "unlike anything":
        excluded = []
    shown = {*excluded, *(name for x in left for name in x.terms)}  # perhaps only beside what was identified
    far = strained(first)
    overstated = overstated_in(of[first.terms], model.effects)
    labels = {name: effect.label for name, effect in model.effects.items()}
    middle, spread = sizes_of(found, first)
    singles = sorted((x for x in found.fitted.values() if len(x.terms) == 1), key=found.odds, reverse=True)
    answer = Diagnosis(
        stack=model.stack,
        verdict=decision.verdict,
        set=tuple(x.terms for x in left),
        labels={**labels, **{name: LABELS[name] for name in model.hypotheses}, **overstated},
        measurement=(*model.hypotheses, *overstated),
        confounded=confounded_in(set(first.terms) - set(overstated), model.effects),
        explained=of[first.terms].explained,
        steps=tuple(of[x.terms] for x in decision.steps),
        discrepancy=middle,
        discrepancy_spread=spread,
        too_large=decision.too_large,
        mixed_up=mixed_up,
        strained=far,
        moved=moved(model.stack, first),
        relieved=tuple(own for own in strained(base) if own.name not in {s.name for s in far}),
        point_change=point_change(model, found, first) if decision.too_large else None,
        ranking=ranking,
        errors=_errors(model, base, left),
        n_used={own.name: (own.frequency.size, own.frequency.size) for own in model.states},
        signatures={
            x.terms[0]: tuple((log_ratios(base)[0] - log_ratios(x)[0]).tolist()) for x in singles[:_SHOWN]
        },
        ruled_out=tuple(excluded),
        not_visible=tuple(name for name in not_visible(seen) if name not in shown),
        lacking=_lacking(model, first),
        impossible=evidence.impossible,
        sensor_gains=sensor_gains(first),
        next_tests=rank_tests(model, found, left[:_COMPARED]),
        second_level=second_level(model, first),
        contact=contact_amplitudes(model, first),
        rig=rig,
        sentences=(),
    )
    return replace(answer, sentences=sentences(answer))


def searched(
    candidates: CandidateModel, evidence: Assembled, asked: Sequence[Sequence[str]] = ()
) -> tuple[StackModel, Search, tuple[MixedUp, ...]]:
    """Return the model, all that was fitted, and the points of the measurement that were put right first."""
    found: list[MixedUp] = []
    tested, priors = evidence.tested, priors_of(evidence.scatter)

    def begun() -> tuple[StackModel, Setting, Explanation]:
        model = StackModel(
            candidates,
            tested,
            evidence.observation,
            evidence.scatter,
            evidence.effects,
            start=float(evidence.start[0]) if evidence.touching else 0.0,
        )
        return model, *begin(model, shares=SHARES, starts=[_start(model, evidence)], priors=priors)

    model, common, base = begun()
    while len(found) < MOST_MIXED:
        right, mixed_up = put_right(
            model,
            model.about(base.coordinates, [base.x]),
            base.x,
            common.noise,
            tested,
            [own.node for own in evidence.observation],
        )
        if mixed_up is None:
            break
        before, tested = tested, right
        again = begun()
        refitted = explain(again[0], [], common, again[2].x)
        if (
            refitted.log_evidence - base.log_evidence < MIXED_UP
        ):  # it does not bear out what first order promised
            tested = before
            break
        model, common, base = again
        found.append(mixed_up)
    return model, search(model, common, base, starts=[_start(model, evidence)], asked=asked), tuple(found)


def priors_of(scatter: DiagnosisScatter) -> tuple[SizePrior, SizePrior]:
    """Return the priors of the sizes of the discrepancy; what a laboratory states of them is known."""
    stiffness, damping = scatter.frequency, scatter.damping
    return (
        STIFFNESS if stiffness is None else SizePrior.exactly(float(np.sqrt(2.0)) * stiffness),
        DAMPING if damping is None else SizePrior.exactly(damping),
    )


def _start(model: StackModel, evidence: Evidence) -> NDArray[np.float64]:
    """Return the coordinates of the base model from which its fit starts."""
    known = dict(zip(evidence.nuisances, evidence.start.tolist(), strict=True))
    return np.array([known.get(c.name, 0.0) if c.name in ("G_f", "d_f") else 0.0 for c in model.nuisances])


def _lacking(model: StackModel, own: Explanation) -> tuple[str, ...]:
    """Return the measured modes that are farther off than any model to which no mode is missing."""
    return tuple(
        f"{state}, mode {r + 1} at {np.sqrt(e.eigenvalue[r]) / (2.0 * np.pi):.1f} Hz"
        for state, e in zip((s.name for s in model.states), own.errors, strict=True)
        for r in np.flatnonzero(np.abs(e.frequency) > STIFFNESS.highest).tolist()
    )


def _errors(model: StackModel, base: Explanation, left: Sequence[Explanation]) -> tuple[ModeError, ...]:
    """List the modes with the frequency errors of the base model and of the first explanation that is left."""
    before = np.expm1(-log_ratios(base)[0])
    after = np.expm1(-log_ratios(left[0])[0]) if left else np.full(before.size, np.nan)
    numbered = [(own, r) for own in model.states for r in range(own.frequency.size)]
    return tuple(
        ModeError(
            configuration=own.name,
            mode=r + 1,
            frequency=float(own.frequency[r]),
            std=float(own.frequency_std[r]),
            base=float(b),
            explained=float(a),
        )
        for (own, r), b, a in zip(numbered, before, after, strict=True)
    )
