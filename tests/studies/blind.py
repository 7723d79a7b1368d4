"""Blind cases for the diagnosis: virtual tests with a sealed effect, drawn by a seed, scored when all is said."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

import model
from ema.types.modal_model import ModalModel
from model import Effect, Parameter, SolveError
from tests.studies.modal_data import ModalNoise, simulate_modes
from tests.studies.runner import BLIND, DATA, study
from updating.diagnosis.cached_model import cached_model
from updating.diagnosis.candidates import CandidateModel, instruments_of
from updating.diagnosis.diagnosis import searched
from updating.diagnosis.evidence import Assembled, Campaigned, assemble_evidence
from updating.diagnosis.experiment import aids
from updating.diagnosis.fit_settings import coordinate_of
from updating.diagnosis.ranking import misfit, not_visible, ruled_out, visibility
from updating.diagnosis.stack_model import StackModel
from updating.inference.decide import decide
from updating.inference.equation_error import equation_errors
from updating.inference.explain import Explanation, coordinates_of, explain
from updating.inference.search import Search
from updating.virtual.vibration_test import VirtualTest, read_virtual_test
from updating.workers.workers import workers

SPECIFICATION = DATA / "demo_stack" / "virtual_test.toml"
RECORD = BLIND / "cases.jsonl"
"""The cases of the published table."""
NOISE = ModalNoise()
"""Standard deviations of the modal data that a case's campaign gives."""
SPREAD = {
    "young": 0.01,
    "density": 0.005,
    "length": 2e-4,
    "width": 2e-4,
    "height": 2e-4,
    "G_f": 0.2,
    "d_f": 0.2,
    "reassembly": 0.02,
    "torque": 0.02,
}
"""Standard deviations of what differs between the bench and the stack file, as ratios."""
G_F, D_F = 1500.0, 2e-11
HELD_OUT, HELD_OUT_PRESSURE = "held out", 240e3
"""A third torque that is simulated but not shown to the diagnosis, with its pressure, Pa."""
MODEL_FORM_ERROR = "model-form error"
"""Kind of a case with a model-form error: its effect is of a known family but follows another law."""
WEAKER = 0.6
"""Share of its strength that such an effect has in the first configuration."""
DETECTABLE = 4.0
"""Distance above which an effect counts as detectable: four standard deviations."""
_Z90 = 1.645  # standard deviations to either side that hold 90 % of a normal distribution
_STEPS = 3  # towards the contact of a configuration that was not fitted


@dataclass(frozen=True, kw_only=True)
class Case:
    """One blind case and what came of it.

    Attributes
    ----------
    seed : int
        Seed of all that was drawn.
    kind : str
        "null", "single", "pair", "withheld" or "model-form error".
    truth : tuple of str
        The planted effects.
    values : mapping of str to float
        Their parameters.
    verdict : str
        Of the diagnosis.
    candidates : tuple of tuple of str
        What it left, the best first.
    ruled_out : tuple of str
        What it says that these data exclude at its usual strength, or more.
    not_visible : tuple of str
        What it says that these data do not show.
    covered : tuple of bool
        Whether each 90 % interval of the true effects' parameters holds the truth, where they were fitted.
    distance : float
        Root of the fall of the misfit from the base model to the true effects, fitted: below `DETECTABLE` nobody could
        name them.
    rival : float
        Root of what the misfit of the best other single effect exceeds that of the truth by: below 3 it is aliased,
        or one of a pair does not show. For an effect that was withheld, of the best of all that was fitted without
        it. Infinite where there is none.
    most_visible, bic : tuple of str
        What two baselines say: the effect that can change the data most, whatever they are; and stepwise
        choice by the Bayesian information criterion.
    held_out : tuple of float
        Root mean square of the differences of frequencies and damping ratios of a third torque that nobody saw, in
        standard deviations, its G_f and d_f fitted: with the base model, with the first candidate (the base model
        where none is named), and with the true effects.
    held_out_frequency : tuple of float
        The same for the mean relative error of frequencies alone.
    """

    seed: int
    kind: str
    truth: tuple[str, ...]
    values: dict[str, float]
    verdict: str
    candidates: tuple[tuple[str, ...], ...]
    ruled_out: tuple[str, ...]
    not_visible: tuple[str, ...]
    covered: tuple[bool, ...]
    distance: float
    rival: float
    most_visible: tuple[str, ...]
    bic: tuple[str, ...]
    held_out: tuple[float, float, float]
    held_out_frequency: tuple[float, float, float]


_QUICK = {"single": 54, "null": 22, "withheld": 24, "pair": 24, MODEL_FORM_ERROR: 10}
_MORE = {"single": 506, "null": 200, "withheld": 186, "pair": 184, MODEL_FORM_ERROR: 90}


def planned(*, full: bool = False) -> tuple[tuple[int, str], ...]:
    """Return seed and kind of the cases: 134, or with `full` 1300, of which those are the first.

    Thresholds of the diagnosis were set, and its faults corrected, on seeds below 99999.
    """
    return (*_mixed(141000, _QUICK), *(_mixed(142000, _MORE) if full else ()))


def _mixed(first: int, number: Mapping[str, int]) -> Iterator[tuple[int, str]]:
    """Mix the kinds, so that what is done says something of each; those of one effect have other draws each."""
    longest = max(number.values())
    apart = 100 * -(-longest // 100)
    for i in range(longest):
        for kind, n in number.items():
            if i * n // longest != (i - 1) * n // longest:
                yield first + i + apart * {"withheld": 1, MODEL_FORM_ERROR: 2}.get(kind, 0), kind


def study_of(cases: Sequence[tuple[int, str]], record: Path) -> list[Case]:
    """Run the cases that are not recorded yet, side by side, and return all of them."""

    def say(case: Case) -> None:
        truth = " with ".join(case.truth) or "nothing"
        left = " or ".join(" with ".join(candidate) for candidate in case.candidates)
        print(f"seed {case.seed}, {case.kind}: {truth} -> {case.verdict} {left}", flush=True)

    with workers(len(cases)) as executor:
        return study(cases, partial(run, SPECIFICATION), record, Case, lambda one: (one.seed, one.kind), executor, say)


def strengths(effect: Effect, rng: np.random.Generator) -> dict[str, float]:
    """Draw a strength, log-uniform from a twentieth of the range up, to either side of neutral where there are two."""
    found = {}
    for p in effect.parameters:
        share = float(np.exp(rng.uniform(np.log(0.05), 0.0)))
        sides = [end for end in (p.lower, p.upper) if end != p.neutral]
        end = sides[int(rng.integers(len(sides)))]
        found[p.name] = _towards(p, end, share) if _is_strength(p) else float(rng.uniform(p.lower, p.upper))
    return found


def weaker(effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
    """Return an effect's values with its strengths `WEAKER` of the way from neutral."""
    return {
        p.name: _towards(p, values[p.name], WEAKER) if _is_strength(p) else values[p.name] for p in effect.parameters
    }


def _is_strength(parameter: Parameter) -> bool:
    """Whether the effect vanishes with the parameter, which else shapes it only."""
    return parameter.scale == "log" or parameter.neutral in (parameter.lower, parameter.upper, 0.0, 1.0)


def _towards(parameter: Parameter, end: float, share: float) -> float:
    """Return the value that lies a share of the way from neutral to an end."""
    if parameter.scale == "log":
        return float(parameter.neutral * (end / parameter.neutral) ** share)
    return float(parameter.neutral + share * (end - parameter.neutral))


def blind_test(specification: Path, seed: int, effects: tuple[Effect, ...], values: dict[str, float]) -> VirtualTest:
    """Return the test of a file, such as that of data/demo_stack, with one G_f, a third torque, and effects."""
    test = read_virtual_test(specification)
    same = [replace(c, G_f=G_F, d_f=D_F) for c in test.configurations]
    third = replace(same[-1], name=HELD_OUT, pressure=HELD_OUT_PRESSURE)
    return replace(test, configurations=(*same, third), effects=effects, effect_values=values, spread=SPREAD, seed=seed)


def candidates_of(specification: Path, effects: dict[str, Effect]) -> CandidateModel:
    """Reduce the nominal model once for all cases."""
    test = blind_test(specification, 0, (), {})
    modes: ModalModel = simulated(test)[0][2]
    stack = model.read_stack(specification.parent / test.stack_file)
    return cached_model(stack, instruments_of(modes), effects, aids())


@cache
def _nominal(specification: Path) -> CandidateModel:
    """Reduce the nominal model with the whole catalogue, once a process."""
    return candidates_of(specification, model.catalogue())


def run(specification: Path, seed: int, kind: str, candidates: CandidateModel | None = None) -> Case:
    """Draw, simulate, diagnose and score one case.

    Parameters
    ----------
    specification : Path
        Virtual test, such as that of data/demo_stack.
    seed : int
        Of all that is drawn.
    kind : str
        "null", "single", "pair", "withheld", the effect then being taken out of the catalogue, or "model-form error":
        its strength in the first configuration is not that in the others, as no effect of the catalogue has it.
    candidates : CandidateModel, optional
        The nominal model; by default with the whole catalogue.
    """
    candidates = _nominal(specification) if candidates is None else candidates
    steady = {name: effect for name, effect in candidates.effects.items() if effect.over_strain is None}
    chosen, values, test, (*tested, unseen) = _drawn(specification, seed, kind, steady)  # one force level shows no slip
    if kind == MODEL_FORM_ERROR:
        less = {k: v for effect in chosen for k, v in weaker(effect, values).items()}
        tested[0] = simulated(replace(test, effect_values=less))[0]
    truth = tuple(sorted(effect.name for effect in chosen))
    evidence = assemble_evidence(candidates, tested)
    offered = evidence
    if kind == "withheld":
        offered = replace(evidence, effects={k: v for k, v in evidence.effects.items() if k not in truth})
    stack, found, _ = searched(candidates, offered)
    decision = decide(found)
    whole = stack.with_effects(evidence.effects)
    true = _true(whole, found, truth, values)
    left = [visibility(stack, found, x) for x in decision.left or (found.base,)]
    sizes = true.evidence.sizes
    singles = [x for x in found.fitted.values() if len(x.terms) == 1]
    rivals = list(found.fitted.values()) if kind == "withheld" else singles
    rises = [misfit(x, sizes) - misfit(true, sizes) for x in rivals if x.terms != truth]
    named = decision.left[0] if decision.left else found.base
    third = assemble_evidence(candidates, [unseen])
    misfits, errors = zip(*(_predicted(whole, third, x) for x in (found.base, named, true)), strict=True)
    reach = {name: max(v.reach for v in of.values()) for name, of in left[0].items()}
    return Case(
        seed=seed,
        kind=kind,
        truth=truth,
        values=values,
        verdict=decision.verdict,
        candidates=tuple(tuple(sorted(x.terms)) for x in decision.left),
        ruled_out=tuple(sorted(set.intersection(*(set(ruled_out(one)) for one in left)))),
        not_visible=not_visible(left[0]),
        covered=_covered(found, truth, values, whole),
        distance=float(np.sqrt(max(misfit(found.base, sizes) - misfit(true, sizes), 0.0))),
        rival=float(np.sqrt(max(min(rises, default=np.inf), 0.0))),
        most_visible=(max(reach, key=lambda name: reach[name]),),
        bic=_bic(found),
        held_out=misfits,
        held_out_frequency=errors,
    )


def _drawn(
    specification: Path, seed: int, kind: str, effects: Mapping[str, Effect]
) -> tuple[tuple[Effect, ...], dict[str, float], VirtualTest, list[Campaigned]]:
    """Draw effects and their values until there can be such a stack, and simulate its test."""
    rng = np.random.default_rng([7, seed])
    names = sorted(effects)
    n = {"null": 0, "single": 1, "withheld": 1, "pair": 2, MODEL_FORM_ERROR: 1}[kind]
    while True:
        chosen: tuple[Effect, ...]
        if n == 1:  # all effects in turn
            chosen = (effects[names[seed % len(names)]],)
        else:
            chosen = tuple(effects[names[i]] for i in rng.choice(len(names), n, replace=False))
        values = {k: v for effect in chosen for k, v in strengths(effect, rng).items()}
        test = blind_test(specification, seed, chosen, values)
        with contextlib.suppress(SolveError):  # where the contact turns negative, in stiffness or in damping alone
            tested = simulated(test)
            if all(np.all(modes.damping > 0.0) for _, _, modes in tested):
                return chosen, values, test, tested


def simulated(test: VirtualTest) -> list[Campaigned]:
    """Return the configurations of a virtual test as an identification would give them, with noise `NOISE`."""
    modes = (drawn for drawn, _ in simulate_modes(test, NOISE).values())
    return [(c.name, c.pressure, m) for c, m in zip(test.configurations, modes, strict=True)]


def _true(model: StackModel, found: Search, truth: tuple[str, ...], values: Mapping[str, float]) -> Explanation:
    """Return the best fit of the true effects: from the truth, or what the search fitted.

    From the truth, the nuisances are sought from the base model's and from what is known.
    """
    base = found.base
    if not truth:
        return base
    terms = [model.terms[name] for name in truth]
    coordinates, known = coordinates_of(model, terms), model.parameters
    held = np.array([np.isfinite(c.std) for c in coordinates])
    fitted = []
    for nuisance in (base.x, np.where(held[: base.x.size], 0.0, base.x)):
        start = [coordinate_of(known[c.name], values[c.name]) for c in coordinates[base.x.size :]]
        fitted.append(explain(model, terms, found.setting, np.concatenate([nuisance, start])))
    one = found.fitted.get(frozenset(truth))
    return max(fitted if one is None else (one, *fitted), key=lambda x: x.log_evidence)


def _covered(found: Search, truth: tuple[str, ...], values: Mapping[str, float], model: StackModel) -> tuple[bool, ...]:
    one = found.fitted.get(frozenset(truth))
    if one is None or not truth:
        return ()
    return tuple(
        bool(abs(coordinate_of(model.parameters[c.name], values[c.name]) - at) <= _Z90 * std)
        for c, at, std in list(zip(one.coordinates, one.x, one.std, strict=True))[one.n_nuisance :]
    )


def _bic(found: Search) -> tuple[str, ...]:
    """Return the explanation with the least misfit and logarithm of the number of data for each parameter."""
    price, sizes = np.log(found.base.problem.value.size), found.base.evidence.sizes
    best = min(found.fitted.values(), key=lambda x: misfit(x, sizes) + price * (x.x.size - x.n_nuisance))
    return tuple(sorted(best.terms))


def _predicted(model: StackModel, third: Assembled, one: Explanation) -> tuple[float, float]:
    """Return how far a configuration is that an explanation has not seen, its own G_f and d_f fitted.

    The first is the root mean square over frequencies and damping ratios in standard deviations, the second the mean
    relative error of frequencies.
    """
    unseen = model.of_tests(third.tested, third.observation)
    coordinates = coordinates_of(unseen, [unseen.terms[name] for name in one.terms])
    have = {c.name: x for c, x in zip(one.coordinates, one.x, strict=True)}
    x = np.array([have.get(c.name, 0.0) for c in coordinates])
    local, state = unseen.about(coordinates, [x]), unseen.states[0]
    noise, sizes = np.full(state.frequency.size, 1e-2 / np.sqrt(len(state.shape))), one.evidence.sizes
    for step in range(_STEPS + 1):
        errors = equation_errors(state, local.modal(x, 0), noise, x.size)
        frequency = errors.frequency / np.hypot(sizes.stiffness / np.sqrt(2.0), state.frequency_std / state.frequency)
        damping = errors.damping / np.hypot(sizes.damping, errors.damping_std)
        value = np.concatenate([frequency, damping])
        if step == _STEPS:
            break
        slope = 0.5 * np.einsum("rs,rsp->rp", errors.weight, errors.jacobian)[:, :2]
        slope /= np.hypot(sizes.stiffness / np.sqrt(2.0), state.frequency_std / state.frequency)[:, None]
        loss = errors.damping_jacobian[:, :2] / np.hypot(sizes.damping, errors.damping_std)[:, None]
        x[:2] -= np.linalg.lstsq(np.vstack([slope, loss]), value, rcond=None)[0]
    return float(np.sqrt(np.mean(value**2))), float(np.mean(np.abs(np.expm1(-errors.frequency))))
