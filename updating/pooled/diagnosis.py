"""Specimens on one rig, diagnosed together: what the rig lacks, which specimens are odd, what a treatment changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.types.arrays import single_threaded
from model import Effect
from updating.diagnosis.answer import VISIBLE
from updating.diagnosis.candidates import CandidateModel, candidate_model
from updating.diagnosis.diagnosis import priors_of
from updating.diagnosis.evidence import DECAY, POINTS_SHIFT, DiagnosisScatter
from updating.diagnosis.fit_settings import FitSettings, scaled
from updating.diagnosis.moved import pulled_text
from updating.errors import FitError
from updating.fitting.fit import ParameterEstimate
from updating.inference.decide import decide
from updating.inference.explain import Explanation
from updating.inference.left_out import LeftOut, left_out
from updating.inference.search import Search
from updating.pooled.joint_parts import Contacts, contrasts_of, far_off, mode_answers
from updating.pooled.search import PooledSearch, begin, fit_terms, searched
from updating.pooled.specimen import Specimen, groups_of, levels_of
from updating.pooled.specimens_model import SpecimensModel, label_of
from updating.results.pooled import Part, PooledDiagnosis, PooledRanked, PooledVerdict, SpecimenAnswer, sentences
from updating.results.text import Z95

Vector = NDArray[np.float64]


@single_threaded
def diagnose_specimens(
    name: str,
    specimens: Sequence[Specimen],
    effects: Mapping[str, Effect],
    *,
    asked: bool = False,
    scatter: DiagnosisScatter | None = None,
    executor: Executor | None = None,
    reduced: Callable[..., CandidateModel] = candidate_model,
) -> PooledDiagnosis:
    """Say what the rig of several specimens lacks, which of them differ and in what, and what a treatment changes.

    Every effect is tried as the rig's, as a group's and as one specimen's. ln G_f and ln d_f scatter from specimen to
    specimen about a mean, by a scatter that is estimated (Gelman and Hill, Data Analysis Using Regression and
    Multilevel Models, 2007, chapter 12); of what a model misses a share is common to all specimens.

    Parameters
    ----------
    name : str
        The campaign.
    specimens : sequence of Specimen
        At least two, on one rig.
    effects : mapping of str to Effect
        The catalogue, or those that the rig is to have.
    asked : bool, default False
        Whether the rig has all of these effects; else they are searched for.
    scatter : DiagnosisScatter, optional
        What a laboratory knows of what separates a right model from a right measurement.
    executor : Executor, optional
        What takes a part of the work, such as `workers`; by default this process does it all.
    reduced : callable
        `candidate_model`, or `cached_model`, which caches the models.

    Raises
    ------
    FitError
        There are fewer than two specimens, no measured mode of one resembles one of its model, or an effect that is
        asked for cannot be.
    PairingError
        Measured points do not lie on a stack, or are fewer than the modes.
    """
    model, impossible = specimens_model(specimens, effects, scatter=scatter, executor=executor, reduced=reduced)
    if asked and impossible:
        raise FitError("; ".join(impossible.values()))
    base_fit = begin(model, priors_of(scatter or DiagnosisScatter()))
    if asked:
        return concluded(name, fit_terms(base_fit, tuple(effects)), impossible, "as asked")
    return concluded(name, searched(base_fit), impossible)


def specimens_model(
    specimens: Sequence[Specimen],
    effects: Mapping[str, Effect],
    *,
    scatter: DiagnosisScatter | None = None,
    executor: Executor | None = None,
    reduced: Callable[..., CandidateModel] = candidate_model,
    settings: FitSettings = FitSettings(),  # noqa: B008  # it is frozen
) -> tuple[SpecimensModel, dict[str, str]]:
    """Return the model of specimens, and why effects cannot be; see `diagnose_specimens`.

    `settings` holds priors, bounds and scopes of parameters.

    Raises
    ------
    FitError
        There are fewer than two specimens, or no measured mode of one resembles one of its model.
    PairingError
        Measured points do not lie on a stack, or are fewer than the modes.
    """
    if len(specimens) < 2:
        raise FitError(f"a pooled diagnosis needs two specimens or more, found {len(specimens)}")
    groups, impossible = groups_of(specimens, effects, scatter=scatter, executor=executor, reduced=reduced)
    return SpecimensModel(specimens, groups, levels_of(specimens), settings=settings), impossible


@dataclass(frozen=True, eq=False)
class _Judged:
    """An explanation with its errors where specimens, and where states, are left out."""

    fit: Explanation
    specimen: LeftOut
    state: LeftOut


def concluded(
    name: str, pooled: PooledSearch, impossible: Mapping[str, str], verdict: PooledVerdict | None = None
) -> PooledDiagnosis:
    """Return the answer that a search comes to; the verdict too, where none is given."""
    ranked = 12  # explanations that are reported
    model, results = pooled.model, pooled.search
    fits = sorted(results.fitted.values(), key=results.odds, reverse=True)
    if verdict is None:
        decision = decide(results)
        verdict, left = decision.verdict, list(decision.left)
    else:
        left = [fit for fit in fits if fit.terms][:1]
    first = left[0] if left else results.base
    rest = [fit for fit in fits[:ranked] if fit not in left and fit is not results.base]
    order = [*left, *sorted([*rest, results.base], key=results.odds, reverse=True)]
    if not left:
        order = sorted({id(fit): fit for fit in order}.values(), key=results.odds, reverse=True)
    odds = np.array([results.odds(fit) for fit in order])
    probability = np.exp(odds - odds.max())
    probability /= probability.sum()
    judged = [_Judged(fit=fit, specimen=left_out(fit, "specimen"), state=left_out(fit, "state")) for fit in order]
    by_fit = {id(item.fit): item for item in judged}
    off = [far_off(model, fit) for fit in (results.base, first)]
    kept = {c.name for c in off[1]}
    middle = first.evidence.moments(results.setting.priors)[0]
    tree = results.setting.tree
    assert tree is not None
    contacts = Contacts(model, first)
    answer = PooledDiagnosis(
        name=name,
        verdict=verdict,
        ranking=tuple(
            _ranked(model, results, item, float(chance)) for item, chance in zip(judged, probability, strict=True)
        ),
        left=max(len(left), 1),
        specimens=tuple(_specimens(model, contacts, results.base, by_fit[id(first)])),
        contrasts=tuple(contrasts_of(model, first)),
        scales={
            "frequency": middle.stiffness / float(np.sqrt(2.0)),
            "damping": middle.damping,
            "stiffness": model.scatter["G_f"],
            "loss": model.scatter["d_f"],
            **dict(zip(("rig", "specimen", "state"), tree.shares, strict=True)),
        },
        not_visible=tuple(
            sorted(n for n, reach in pooled.reach.items() if n in model.first.effects and reach < VISIBLE)
        ),
        impossible=dict(impossible),
        relieved=tuple(pulled_text([c for c in off[0] if c.name not in kept])) if left else (),
        pulled=tuple(pulled_text(off[1])),
        sentences=(),
    )
    return replace(answer, sentences=sentences(answer))


def _ranked(model: SpecimensModel, results: Search, judged: _Judged, probability: float) -> PooledRanked:
    fit = judged.fit
    several = [c for states in model.states_of if len(states) > 1 for c in states]
    return PooledRanked(
        parts=_parts(model, results, fit),
        log_odds=results.odds(fit),
        probability=probability,
        frequency_error=_error(fit, range(len(fit.errors))),
        left_out_error=_mean(judged.specimen, range(len(fit.errors))),
        left_out_torque_error=_mean(judged.state, several),
    )


def _parts(model: SpecimensModel, results: Search, fit: Explanation) -> tuple[Part, ...]:
    """Return the terms of an explanation, each with its gain beside the others."""
    parts = []
    for name in fit.terms:
        rest = frozenset(fit.terms) - {name}
        without = results.fitted.get(rest)
        log_odds = results.odds(fit) - results.odds(without) if without else float("nan")
        parts.append(part_of(model, fit, name, label_of(model.first, model.meant[name].effect), log_odds))
    return tuple(parts)


def _error(fit: Explanation, states: Sequence[int]) -> float:
    """Return the mean relative error of the frequencies of some states."""
    log = np.concatenate([fit.errors[c].frequency for c in states])
    return float(np.mean(np.abs(np.expm1(-log))))


def _mean(predicted: LeftOut, states: Sequence[int]) -> float:
    """Return the mean magnitude of the errors of frequencies of some states; NaN of none."""
    errors = predicted.errors["frequency"][np.isin(predicted.state, list(states))]
    errors = errors[np.isfinite(errors)]
    return float(np.mean(np.abs(errors))) if errors.size else float("nan")


def _specimens(model: SpecimensModel, contacts: Contacts, base: Explanation, judged: _Judged) -> list[SpecimenAnswer]:
    """Return what is said of each specimen."""
    fit, answers = judged.fit, []
    alone = {
        s: [model.meant[n].effect for n in fit.terms if model.meant[n].level.members == (s,)]
        for s in range(len(model.specimens))
    }
    for s, specimen in enumerate(model.specimens):
        states = model.states_of[s]
        G_f, d_f = contacts.of_specimen(s)
        answers.append(
            SpecimenAnswer(
                name=specimen.name,
                notes=dict(specimen.notes),
                n_mode=sum(model.states[c].frequency.size for c in states),
                G_f=G_f,
                d_f=d_f,
                base_error=_error(base, states),
                error=_error(fit, states),
                left_out_error=_mean(judged.specimen, states),
                odd=tuple(alone[s]),
                states=tuple(contacts.of_state(c) for c in states),
                modes=mode_answers(model, base, fit, states),
            )
        )
    return answers


def part_of(model: SpecimensModel, fit: Explanation, name: str, label: str, log_odds: float) -> Part:
    """Return a term of an explanation with its 95 % intervals.

    Parameters
    ----------
    model : SpecimensModel
        The model.
    fit : Explanation
        The explanation.
    name : str
        The term.
    label : str
        Its label.
    log_odds : float
        Its gain in log odds beside the other terms.
    """
    term, meant = model.terms[name], model.meant[name]
    shown = [c.name for c in term.coordinates] or list(term.frees)
    return Part(
        effect=meant.effect,
        label=label,
        level=meant.level.kind,
        of=meant.level.of,
        specimens=tuple(model.specimens[s].name for s in meant.level.members),
        parameter=tuple(estimate_of(model, fit, n) for n in shown),
        log_odds=log_odds,
    )


def estimate_of(model: SpecimensModel, fit: Explanation, name: str) -> ParameterEstimate:
    """Return a coordinate as the parameter that it is of; of a stated value the ratio, of a location the shift."""
    i = [c.name for c in fit.coordinates].index(name)
    c, local = fit.coordinates[i], model.scope(name).local
    ends = np.clip(fit.x[i] + Z95 * fit.std[i] * np.array([0.0, -1.0, 1.0]), c.lower, c.upper)
    unit = "1"
    if local in model.parameters:
        p = model.parameters[local]
        values, unit = [scaled(p, float(z))[0] for z in ends], p.unit
    elif local in (*model.first.clamp_locations, POINTS_SHIFT):
        values, unit = ends.tolist(), "m"
    elif local == DECAY:
        values, unit = ends.tolist(), "1/s"
    else:
        values = np.exp(ends).tolist()
    return ParameterEstimate(
        name=local,
        unit=unit,
        value=float(values[0]),
        lower=float(min(values[1:])),
        upper=float(max(values[1:])),
        at_bound=bool(fit.at_bound[i]),
    )
