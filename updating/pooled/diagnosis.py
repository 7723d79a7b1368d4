"""Specimens on one rig, diagnosed together: what the rig lacks, which specimens are odd, what a treatment changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.types.threads import single_threaded
from model import Effect
from updating.diagnosis.calibration import VISIBLE
from updating.diagnosis.candidates import CandidateModel, candidate_model
from updating.diagnosis.discrepancy import KINDS
from updating.diagnosis.evidence import DiagnosisScatter
from updating.diagnosis.explanation import Z95
from updating.diagnosis.nuisance_text import strained
from updating.errors import FitError
from updating.pooled.beside import Bench, bench
from updating.pooled.fit import Fitted, Weighing
from updating.pooled.held_out import SpecimensLeftOut, specimens_left_out, torques_left_out
from updating.pooled.linear import Scales
from updating.pooled.matter import far_off, relieves
from updating.pooled.parts import parts_of
from updating.pooled.screening import contrasts
from updating.pooled.search import Found, asked, search
from updating.pooled.specimen import Level, Specimen, levels_of
from updating.pooled.states import (
    UNITS,
    contact_logs,
    contact_states,
    estimate,
    modes_told,
    nominal_contact,
)
from updating.pooled.term import CONTACT
from updating.pooled.verdict import not_told_apart, verdict_of
from updating.results.pooled_answer import (
    Contrast,
    Part,
    PooledDiagnosis,
    PooledRanked,
    PooledVerdict,
    SpecimenAnswer,
)
from updating.results.pooled_text import sentences

Vector = NDArray[np.float64]

_RANKED = 12  # explanations that are told
_UNTOLD = np.log(
    100.0
)  # half of an interval of a ratio's logarithm, beyond which nothing is said of the ratio
_ENDS = 1e-4  # of a range, within which a coordinate lies on an end


@single_threaded
def diagnose_specimens(
    name: str,
    specimens: Sequence[Specimen],
    effects: Mapping[str, Effect],
    *,
    scatter: DiagnosisScatter | None = None,
    executor: Executor | None = None,
    reduced: Callable[..., CandidateModel] = candidate_model,
) -> PooledDiagnosis:
    """Say what the rig of several specimens lacks, which of them differ and in what, and what a treatment changes.

    Every effect is tried as the rig's, as a group's, as one specimen's and as each specimen's own. ln G_f and ln d_f
    scatter from specimen to specimen about a mean, by a scatter that is estimated (Gelman and Hill, Data Analysis Using
    Regression and Multilevel Models, 2007, chapter 12); what a model misses of a mode is common to all specimens.

    Parameters
    ----------
    name : str
        The campaign.
    specimens : sequence of Specimen
        At least two, on one rig.
    effects : mapping of str to Effect
        The catalogue.
    scatter : DiagnosisScatter, optional
        What a laboratory knows of what separates a right model from a right measurement.
    executor : Executor, optional
        What takes a part of the work, such as `workers`; by default this process does it all.
    reduced : callable
        `candidate_model`, or `cached_model`, which caches the models.

    Raises
    ------
    FitError
        There are fewer than two specimens, or no measured mode of one resembles one of its model.
    PairingError
        Measured points do not lie on a stack, or are fewer than the modes.
    """
    beside = bench(specimens, effects, scatter=scatter, executor=executor, reduced=reduced)
    return concluded(name, search(beside, levels_of(specimens), executor))


@single_threaded
def fit_specimens(
    name: str,
    specimens: Sequence[Specimen],
    effects: Mapping[str, Effect],
    *,
    executor: Executor | None = None,
    reduced: Callable[..., CandidateModel] = candidate_model,
) -> PooledDiagnosis:
    """Fit effects of the rig to all its specimens, each with contact parameters of its own, as a diagnosis does it.

    Parameters
    ----------
    name : str
        The campaign.
    specimens : sequence of Specimen
        At least two, on one rig.
    effects : mapping of str to Effect
        Those that the rig is to have; none fits the base model.
    executor, reduced
        As in `diagnose_specimens`.

    Raises
    ------
    FitError
        There are fewer than two specimens, no measured mode of one resembles one of its model, an effect cannot be, or
        the model has no modes with all of them.
    PairingError
        Measured points do not lie on a stack, or are fewer than the modes.
    """
    beside = bench(specimens, effects, executor=executor, reduced=reduced)
    if beside.impossible:
        message = "; ".join(beside.impossible.values())
        raise FitError(message)
    return concluded(name, asked(beside, levels_of(specimens), tuple(effects), executor), "as asked")


def concluded(name: str, found: Found, verdict: PooledVerdict | None = None) -> PooledDiagnosis:
    """Return the answer that a search comes to; the verdict too, where none is given."""
    beside = found.bench
    told, parts = _told(found)
    odds = np.array([found.odds(own) for own in told])
    probability = np.exp(odds - odds.max())
    probability /= probability.sum()
    left_out = [specimens_left_out(beside, own) for own in told]
    base = next(i for i, own in enumerate(told) if not own.terms)
    ranking = tuple(
        PooledRanked(
            parts=parts[i],
            log_odds=float(odds[i]),
            probability=float(probability[i]),
            frequency_error=own.frequency_error,
            left_out_error=float(np.mean(left_out[i].error)),
            left_out_torque_error=_mean(torques_left_out(beside, own)),
            left_out_score=float(np.sum(left_out[i].score - left_out[base].score)),
            relieves=relieves(beside, told[base], own, range(len(beside.own))),
        )
        for i, own in enumerate(told)
    )
    adequate, near = told[0].scales.adequate, [0]
    if verdict is None:
        near = not_told_apart(ranking, ranking[base], [own.error for own in left_out], adequate=adequate)
        enough = (adequate, told[base].scales.adequate)
        verdict = verdict_of(ranking[near[0]], ranking[base], adequate=enough, n_near=len(near))
    best = base if verdict in ("nothing missing", "unlike anything") else near[0]
    order = [*near, *(i for i in range(len(told)) if i not in near)]
    off = [far_off(beside, told[i]) for i in (base, best)]
    answer = PooledDiagnosis(
        name=name,
        verdict=verdict,
        ranking=tuple(ranking[i] for i in order),
        left=len(near) if verdict in ("one of", "partly explained") else 1,
        specimens=tuple(_specimens(beside, told[base], told[best], left_out[best])),
        contrasts=tuple(_contrasts(beside, told[best], found.levels)),
        scales=_told_scales(told[best].scales),
        not_visible=tuple(
            sorted(
                own.term.effect
                for own in found.screened
                if own.term.level.kind == "rig"
                and own.term.effect in beside.effects
                and own.detectability < VISIBLE
            )
        ),
        impossible=beside.impossible,
        relieved=tuple(strained([own for own in off[0] if own.name not in {still.name for still in off[1]}])),
        strained=tuple(strained(off[1])),
        sentences=(),
    )
    return replace(answer, sentences=sentences(answer))


def _told(found: Found) -> tuple[list[Fitted], list[tuple[Part, ...]]]:
    """Return the explanations that are told, each with its parts: of those that say the same the most probable one."""
    told: list[Fitted] = []
    parts: list[tuple[Part, ...]] = []
    said = set()
    for own in (*found.fitted[:_RANKED], _base(found)):
        of = parts_of(found, own)
        key = frozenset((part.effect, part.level, part.specimens) for part in of)
        if key not in said:
            said.add(key)
            told.append(own)
            parts.append(of)
    return told, parts


def _told_scales(scales: Scales) -> dict[str, float]:
    """Return how much scatters, of discrepancies what is common and what is own together."""
    return {
        **{kind: scales.whole(kind) for kind in KINDS},
        "stiffness": scales.stiffness,
        "loss": scales.loss,
    }


def _mean(errors: Vector) -> float:
    return float(np.mean(errors)) if errors.size else float("nan")


def _base(found: Found) -> Fitted:
    return next(own for own in found.fitted if not own.terms)


def _specimens(beside: Bench, base: Fitted, own: Fitted, left_out: SpecimensLeftOut) -> list[SpecimenAnswer]:
    """Return what is said of each specimen."""
    weighing = Weighing(beside, own.linear, own.coordinates, own.at.coordinate)
    every = weighing.reduced(own.scales)
    joint = weighing.joined(every, own.scales)
    n = joint.slope.size - len(own.coordinates)
    unseen = np.concatenate([np.zeros(n), [c.unseen for c in own.coordinates]])
    covariance = np.linalg.inv(joint.precision + np.diag(unseen))
    found, states = [], contact_states(beside, own)
    for s, specimen in enumerate(beside.own):
        names = specimen.evidence.nuisances
        where = own.linear.placed(s, own.coordinates)
        back = np.hstack([every[s].back[:, :n], every[s].back[:, n:-1] @ where])
        std = np.sqrt(np.diag(every[s].covariance + back @ covariance @ back.T))
        nominal, logs = nominal_contact(beside, s), contact_logs(own, s, names)
        contact = {
            name: estimate(name, nominal[name], logs[name], float(std[names.index(name)]))
            if any(getattr(state, name) for state in states[s])
            else None
            for name in UNITS
        }
        found.append(
            SpecimenAnswer(
                name=specimen.specimen.name,
                notes=dict(specimen.specimen.notes),
                n_mode=sum(used.size for used in specimen.evidence.used),
                G_f=contact["G_f"],
                d_f=contact["d_f"],
                base_error=base.linear.found[s].frequency_error,
                error=own.linear.found[s].frequency_error,
                left_out_error=float(left_out.error[s]),
                odd=tuple(t.effect for t in own.terms if t.level.kind == "specimen" and s in t.level.members),
                states=states[s],
                modes=modes_told(specimen.evidence, base.linear.found[s], own.linear.found[s]),
            )
        )
    return found


def _contrasts(beside: Bench, own: Fitted, levels: Sequence[Level]) -> list[Contrast]:
    """Return what groups have of contact parameters over the others."""
    if not all(each.evidence.touching for each in beside.own):
        return []
    asked = [(name, level) for level in levels if level.kind == "group" for name in CONTACT]
    found = []
    for (name, level), (value, std) in zip(asked, contrasts(beside, own, asked), strict=True):
        if Z95 * std > _UNTOLD:
            continue
        ratio, lower, upper = np.exp(value + Z95 * std * np.array([0.0, -1.0, 1.0])).tolist()
        found.append(
            Contrast(
                group=level.of, parameter=name, label=CONTACT[name], ratio=ratio, lower=lower, upper=upper
            )
        )
    return found
