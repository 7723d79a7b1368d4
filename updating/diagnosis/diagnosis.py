"""Which physical effect is missing, how sure that is, what cannot be told apart, and what cannot be seen.

The base model is fitted first, then effects and what may be wrong with the measurement, alone and together
(`updating.inference`). They are compared by evidence, the size of the discrepancy that every model has being integrated
out. What the data cannot tell apart is reported as a set.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.types.arrays import single_threaded
from model import Effect, Stack
from updating.correlation.pairing import require_points
from updating.correlation.rig_check import RigCheck, check_rig, upright
from updating.diagnosis.answer import Diagnosis, MixedUp
from updating.diagnosis.candidates import G_F_RANGE, CandidateModel, candidate_model, instruments_of
from updating.diagnosis.evidence import Assembled, Campaigned, DiagnosisScatter, Tested, assemble_evidence
from updating.diagnosis.experiment import aids, contact_amplitudes, rank_tests, second_level
from updating.diagnosis.fit_settings import FitSettings
from updating.diagnosis.points import point_change, search_corrected
from updating.diagnosis.ranking import answer_of
from updating.diagnosis.slipping import AtLevel
from updating.diagnosis.stack_model import StackModel
from updating.diagnosis.text import sentences
from updating.errors import FitError
from updating.inference.decide import decide
from updating.inference.discrepancy import DAMPING, STIFFNESS, SizePrior
from updating.inference.search import Search

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
    candidates, evidence, rig = beside_model(
        stack, tested, effects, scatter=scatter, executor=executor, reduced=reduced, levels=levels
    )
    return conclude(candidates, evidence, asked, rig)


def beside_model(
    stack: Stack,
    tested: Sequence[Campaigned],
    effects: Mapping[str, Effect],
    *,
    scatter: DiagnosisScatter | None = None,
    executor: Executor | None = None,
    reduced: Callable[..., CandidateModel] = candidate_model,
    levels: Mapping[str, AtLevel] | None = None,
) -> tuple[CandidateModel, Assembled, tuple[RigCheck, ...]]:
    """Return the model of a stack, what was measured beside it, and what was checked of the rig; see `diagnose`.

    Raises
    ------
    FitError
        No measured mode of a configuration resembles one of the model.
    PairingError
        Measured points do not lie on the stack, or are fewer than the modes, or a sensor was upside down in all runs.
    """
    if not tested:
        raise FitError("nothing to diagnose: no configuration was identified")
    for _, _, modes in tested:
        require_points(modes)
    candidates = reduced(stack, instruments_of(tested[0][2]), effects, aids(), executor)
    rig = tuple(upright(check_rig(candidates.system, pressure, modes, G_F_RANGE)) for _, pressure, modes in tested)
    return candidates, assemble_evidence(candidates, tested, scatter=scatter, levels=levels), rig


def conclude(
    candidates: CandidateModel, evidence: Assembled, asked: Sequence[Sequence[str]] = (), rig: tuple[RigCheck, ...] = ()
) -> Diagnosis:
    """Say which effect is missing from evidence that has been assembled; see `diagnose`.

    `rig` is what was checked of force, scale and sensors of each configuration.
    """
    compared = 3  # explanations between which further tests are to tell
    model, search, mixed_up = searched(candidates, evidence, asked)
    decision = decide(search)
    first = decision.left[0] if decision.left else search.base
    answer = replace(
        answer_of(model, search, decision, asked),
        stack=model.stack,
        mixed_up=mixed_up,
        point_change=point_change(model, search, first) if decision.too_large else None,
        impossible=evidence.impossible,
        next_tests=rank_tests(model, search, decision.left[:compared]),
        second_level=second_level(model, first),
        contact=contact_amplitudes(model, first),
        rig=rig,
    )
    return replace(answer, sentences=sentences(answer))


def searched(
    candidates: CandidateModel,
    evidence: Assembled,
    asked: Sequence[Sequence[str]] = (),
    settings: FitSettings = FitSettings(),  # noqa: B008  # it is frozen
) -> tuple[StackModel, Search, tuple[MixedUp, ...]]:
    """Return the model, all that was fitted, and the points of the measurement that were corrected first.

    `settings` is what is known of parameters of the base model beforehand.
    """

    def make(tested: Sequence[Tested]) -> tuple[StackModel, list[NDArray[np.float64]]]:
        model = StackModel(
            candidates,
            tested,
            evidence.observation,
            evidence.scatter,
            evidence.effects,
            start=evidence.start["G_f"],
            settings=settings,
        )
        return model, [start_of(model, evidence)]

    node = [points.node for points in evidence.observation]
    priors = priors_of(evidence.scatter)
    return search_corrected(make, evidence.tested, node, shares=SHARES, priors=priors, asked=asked)


def priors_of(scatter: DiagnosisScatter) -> tuple[SizePrior, SizePrior]:
    """Return the priors of the sizes of the discrepancy; what a laboratory states of them is known."""
    stiffness, damping = scatter.frequency, scatter.damping
    return (
        STIFFNESS if stiffness is None else SizePrior.exactly(float(np.sqrt(2.0)) * stiffness),
        DAMPING if damping is None else SizePrior.exactly(damping),
    )


def start_of(model: StackModel, evidence: Assembled) -> NDArray[np.float64]:
    """Return the coordinates of the base model from which its fit starts."""
    return np.array([evidence.start.get(c.name, 0.0) for c in model.nuisances])
