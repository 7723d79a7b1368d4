"""Which physical effect is missing, how sure that is, what cannot be told apart, and what cannot be seen.

The base model is fitted first. Each effect is then scored by what its signature explains of the residual after the
nuisances' share is taken out; the best are fitted in full, alone and together, and compared by evidence, the size of
the discrepancy that every model has being integrated out. What the data cannot tell apart is reported as a set.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from ema.types.threads import single_threaded
from model import Effect, Stack
from updating.correlation.pairing import require_points
from updating.correlation.rig_check import RigCheck, check_rig, upright
from updating.diagnosis.adequacy import too_large
from updating.diagnosis.answer import Diagnosis, ModeError, Strained, confounded_in, overstated_in
from updating.diagnosis.assembly import Assembled, Campaigned, assemble_evidence
from updating.diagnosis.calibration import STRAINED, VISIBLE
from updating.diagnosis.candidates import G_F_RANGE, CandidateModel, candidate_model, instruments_of
from updating.diagnosis.contact_amplitude import contact_amplitudes
from updating.diagnosis.evidence import DiagnosisScatter, Evidence, Tested
from updating.diagnosis.exclusion import ruled_out
from updating.diagnosis.experiment import aids, rank_tests
from updating.diagnosis.explanation import Explanation
from updating.diagnosis.hypotheses import LABELS
from updating.diagnosis.ranking import rank
from updating.diagnosis.search import Search, search
from updating.diagnosis.second_level import second_level
from updating.diagnosis.sensor_gain import sensor_gains
from updating.diagnosis.slipping import AtLevel
from updating.diagnosis.text import sentences
from updating.diagnosis.verdict import decide
from updating.errors import FitError

_LOG = logging.getLogger(__name__)

_SHOWN = 8  # single effects whose changes are told mode by mode
_COMPARED = 4  # explanations between which further tests are to tell


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
    return conclude(evidence, executor, asked, rig)


def conclude(
    evidence: Assembled,
    executor: Executor | None = None,
    asked: Sequence[Sequence[str]] = (),
    rig: tuple[RigCheck, ...] = (),
) -> Diagnosis:
    """Say which effect is missing from evidence that has been assembled; see `diagnose`.

    `rig` is what was checked of force, scale and sensors of each configuration.
    """
    found = search(evidence, executor, asked)
    _LOG.info("weigh %d explanations", len(found.explanations))
    decision = decide(found)
    base, left = found.base, decision.left
    first = left[0] if left else base
    ranking = rank(found, (*decision.steps, *left))
    of = {own.effects: own for own in ranking}
    excluded = ruled_out(found, decision)
    shown = {*excluded, *(name for x in left for name in x.effects)}  # perhaps only beside what was found
    evidence = found.evidence
    strained = _strained(evidence.supposing(first.effects), first)
    overstated = overstated_in(of[first.effects], evidence.effects)
    answer = Diagnosis(
        verdict=decision.verdict,
        set=tuple(x.effects for x in left),
        labels={**_labels(found), **overstated},
        measurement=(*evidence.hypotheses, *overstated),
        confounded=confounded_in(set(first.effects) - set(overstated), evidence.effects),
        explained=of[first.effects].explained,
        steps=tuple(of[x.effects] for x in decision.steps),
        discrepancy=first.mean if evidence.touching else replace(first.mean, damping=np.nan),
        discrepancy_spread=first.spread,
        too_large=too_large(evidence, first),
        mixed_up=found.mixed_up,
        strained=strained,
        relieved=tuple(
            own for own in _strained(evidence, base) if own.name not in {s.name for s in strained}
        ),
        point_change=decision.point,
        ranking=ranking,
        errors=_errors(evidence, base, left),
        n_used=_n_used(evidence),
        signatures={
            x.effects[0]: tuple((base.residual.log_frequency - x.residual.log_frequency).tolist())
            for x in found.singles[:_SHOWN]
        },
        ruled_out=excluded,
        not_visible=tuple(
            sorted(s.effect for s in found.screened if s.detectability < VISIBLE and s.effect not in shown)
        ),
        lacking=tuple(_labelled(evidence.tested[c], r) for c, r in evidence.lacking),
        impossible=evidence.impossible,
        sensor_gains=sensor_gains(evidence, first),
        next_tests=rank_tests(evidence, left[:_COMPARED]),
        second_level=second_level(evidence.supposing(first.effects), first),
        contact=contact_amplitudes(evidence, first),
        rig=rig,
        sentences=(),
    )
    return replace(answer, sentences=sentences(answer))


def _strained(evidence: Evidence, own: Explanation) -> tuple[Strained, ...]:
    """Return the nuisances that an explanation needs far from what is known of them; gains are told apart."""
    far = np.abs(own.nuisance) > STRAINED * evidence.prior_std
    return tuple(
        Strained(name=name, value=float(own.nuisance[i]), std=float(evidence.prior_std[i]))
        for i, name in enumerate(evidence.nuisances)
        if far[i] and not name.startswith("gain")
    )


def _n_used(evidence: Evidence) -> dict[str, tuple[int, int]]:
    """Return how many modes of each configuration are used, and how many were identified."""
    return {
        t.name: (int(used.size), int(t.modes.frequency.size))
        for t, used in zip(evidence.tested, evidence.used, strict=True)
    }


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
        **{name: effect.label for name, effect in found.evidence.effects.items()},
        **{name: LABELS[name] for name in found.evidence.hypotheses},
    }
