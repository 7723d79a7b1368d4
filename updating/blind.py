"""Blind cases for the diagnosis: virtual tests with a sealed effect, drawn by a seed, scored when all is said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

import model
from model import Effect
from updating.candidates import CandidateModel, candidate_model, instruments_of
from updating.coordinates import coordinate_of
from updating.diagnosis import Diagnosis, conclude
from updating.evidence import Evidence, gather
from updating.experiment import aids
from updating.explanation import explain
from updating.virtual_measurement import ModalNoise, play_modes
from updating.virtual_test import VirtualTest
from updating.virtual_test_file import read_virtual_test

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
DETECTABLE = 4.0
"""Distance above which an effect counts as detectable: the root of `diagnosis.GAIN_SINGLE`."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One blind case and what came of it.

    Attributes
    ----------
    seed : int
        Seed of all that was drawn.
    kind : str
        "null", "single", "pair" or "withheld".
    truth : tuple of str
        The planted effects.
    values : mapping of str to float
        Their parameters.
    verdict, candidates, not_visible, p_value
        Of the diagnosis.
    covered : tuple of bool
        Whether each 90 % interval of the true effects' parameters holds the truth, where they were fitted.
    distance : float
        Root of the fall of the misfit from the base model to the true effects, fitted: below `DETECTABLE` nobody could
        name them.
    error_before, error_after : float
        Mean frequency error of the base model and of the first candidate.
    """

    seed: int
    kind: str
    truth: tuple[str, ...]
    values: dict[str, float]
    verdict: str
    candidates: tuple[tuple[str, ...], ...]
    not_visible: tuple[str, ...]
    p_value: float
    covered: tuple[bool, ...]
    distance: float
    error_before: float
    error_after: float


def strengths(effect: Effect, rng: np.random.Generator) -> dict[str, float]:
    """Draw a strength, log-uniform from a twentieth of the range up, to either side of neutral where there are two."""
    found = {}
    for p in effect.parameters:
        share = float(np.exp(rng.uniform(np.log(0.05), 0.0)))
        sides = [end for end in (p.lower, p.upper) if end != p.neutral]
        end = sides[int(rng.integers(len(sides)))]
        if p.scale == "log":
            found[p.name] = float(p.neutral * (end / p.neutral) ** share)
        elif p.neutral in (p.lower, p.upper) or p.neutral in (0.0, 1.0):
            found[p.name] = float(p.neutral + share * (end - p.neutral))
        else:  # it shapes the effect and has no strength of its own
            found[p.name] = float(rng.uniform(p.lower, p.upper))
    return found


def blind_test(
    specification: Path, seed: int, effects: tuple[Effect, ...], values: dict[str, float]
) -> VirtualTest:
    """Return the test of a file, such as that of data/demo_stack, with one G_f for all torques and effects planted."""
    test = read_virtual_test(specification)
    same = tuple(replace(c, G_f=G_F, d_f=D_F) for c in test.configurations)
    return replace(test, configurations=same, effects=effects, effect_values=values, spread=SPREAD, seed=seed)


def candidates_of(specification: Path, effects: dict[str, Effect]) -> CandidateModel:
    """Reduce the nominal model once for all cases."""
    test = blind_test(specification, 0, (), {})
    modes = next(iter(play_modes(test, NOISE).values()))[0]
    stack = model.read_stack(specification.parent / test.stack_file)
    return candidate_model(stack, instruments_of(modes), effects, aids())


def run(specification: Path, seed: int, kind: str, candidates: CandidateModel) -> Case:
    """Draw, play, diagnose and score one case.

    `kind` is "null", "single", "pair" or "withheld", the effect then being taken out of the catalogue.
    """
    rng = np.random.default_rng([7, seed])
    names = sorted(candidates.effects)
    n = {"null": 0, "single": 1, "withheld": 1, "pair": 2}[kind]
    chosen: tuple[Effect, ...]
    if n == 1:  # all effects in turn
        chosen = (candidates.effects[names[seed % len(names)]],)
    else:
        chosen = tuple(candidates.effects[names[i]] for i in rng.choice(len(names), n, replace=False))
    values = {k: v for effect in chosen for k, v in strengths(effect, rng).items()}
    test = blind_test(specification, seed, chosen, values)
    tested = [
        (c.name, c.pressure, played[0])
        for c, played in zip(test.configurations, play_modes(test, NOISE).values(), strict=True)
    ]
    truth = tuple(sorted(effect.name for effect in chosen))
    offered = candidates
    if kind == "withheld":
        offered = replace(candidates, effects={k: v for k, v in candidates.effects.items() if k not in truth})
    found = conclude(gather(offered, tested))
    return _scored(seed, kind, truth, values, found, _distance(gather(candidates, tested), truth, values))


def _distance(evidence: Evidence, truth: tuple[str, ...], values: Mapping[str, float]) -> float:
    """Return how far the base model is from the data beyond the model with the true effects."""
    base = explain(evidence)
    start = np.array([coordinate_of(p, values[p.name]) for p in evidence.parameters(truth)])
    true = explain(evidence, truth, nuisance=base.nuisance, coordinate=start) if truth else base
    return float(np.sqrt(max(base.misfit - true.misfit, 0.0)))


def _scored(
    seed: int,
    kind: str,
    truth: tuple[str, ...],
    values: dict[str, float],
    found: Diagnosis,
    distance: float,
) -> Case:
    ranked = {tuple(sorted(x.effects)): x for x in found.ranking}
    own = ranked.get(truth)
    best = ranked[tuple(sorted(found.candidates[0]))] if found.candidates else ranked[()]
    return Case(
        seed=seed,
        kind=kind,
        truth=truth,
        values=values,
        verdict=found.verdict,
        candidates=tuple(tuple(sorted(c)) for c in found.candidates),
        not_visible=found.not_visible,
        p_value=found.p_value,
        covered=tuple(p.lower <= values[p.name] <= p.upper for p in own.parameter) if own else (),
        distance=distance,
        error_before=ranked[()].frequency_error,
        error_after=best.frequency_error,
    )


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A share of cases with its 95 % binomial interval (Clopper and Pearson 1934)."""

    name: str
    target: str
    hits: int
    total: int

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end; (0, 1) without cases."""
        if not self.total:
            return 0.0, 1.0
        found = binomtest(self.hits, self.total).proportion_ci(method="exact")
        return float(found.low), float(found.high)


def figures(cases: Sequence[Case]) -> tuple[Figure, ...]:
    """Score cases: how often nothing, the right effect, the right set, or nothing wrong was said."""
    null = [c for c in cases if c.kind == "null"]
    single = [c for c in cases if c.kind == "single"]
    seen = [c for c in single if c.distance >= DETECTABLE]
    unseen = [c for c in single if c.distance < DETECTABLE]
    pairs = [c for c in cases if c.kind == "pair" and c.distance >= DETECTABLE]
    withheld = [c for c in cases if c.kind == "withheld"]
    far = [c for c in withheld if c.distance >= 5.0]

    def within(c: Case) -> bool:
        return any(set(c.truth) <= set(candidate) for candidate in c.candidates)

    def top(c: Case) -> bool:
        return bool(c.candidates) and c.candidates[0] == c.truth

    intervals = [hit for c in seen for hit in c.covered]
    count = Figure
    return (
        count(
            name="false alarms on nulls",
            target="<= 5 %",
            hits=sum(c.verdict != "nothing missing" for c in null),
            total=len(null),
        ),
        count(
            name="named or in the set, detectable singles",
            target="95 %",
            hits=sum(map(within, seen)),
            total=len(seen),
        ),
        count(
            name="top choice right, detectable singles",
            target="90 %",
            hits=sum(map(top, seen)),
            total=len(seen),
        ),
        count(
            name="top choice right, all singles",
            target="reported",
            hits=sum(map(top, single)),
            total=len(single),
        ),
        count(name="both of a pair right", target="80 %", hits=sum(map(top, pairs)), total=len(pairs)),
        count(
            name="unlike anything, withheld beyond 5 sigma",
            target="90 %",
            hits=sum(c.verdict == "unlike anything" for c in far),
            total=len(far),
        ),
        count(
            name="unlike anything, all withheld",
            target="65 %",
            hits=sum(c.verdict == "unlike anything" for c in withheld),
            total=len(withheld),
        ),
        count(
            name="undetectable singles not wrongly named",
            target="95 %",
            hits=sum(c.verdict in ("nothing missing", "unlike anything") or within(c) for c in unseen),
            total=len(unseen),
        ),
        count(
            name="90 % parameter intervals hold",
            target="85 to 95 %",
            hits=sum(intervals),
            total=len(intervals),
        ),
    )
