"""How often a pooled diagnosis is right: six specimens of the layered model, with something of the rig, a group or one.

All cases have one stack file, so one reduced model does for them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import model
from ema.types.arrays import single_threaded
from tests.independent.bench import SecondModel
from tests.independent.campaign import STACK, Plan
from tests.independent.effects import TABLE, draw_strength
from tests.independent.setups import SETUPS
from tests.recovery.reference_models import simulated
from tests.studies.runner import BLIND, Share, share, study
from updating.diagnosis.candidates import CandidateModel, candidate_model
from updating.diagnosis.diagnosis import diagnose
from updating.inference.explain import Explanation, coordinates_of, explain
from updating.pooled.diagnosis import concluded, specimens_model
from updating.pooled.search import PooledSearch, begin, searched
from updating.pooled.specimen import Specimen
from updating.results.pooled import PooledDiagnosis

RECORD = BLIND / "pooled.jsonl"
"""The cases of the published table."""
FIRST_SEED = 727_000
"""Of the published cases; seeds from 720000 to 726011 were looked at before."""
N_SPECIMEN = 6
SHOWN = 0.5
"""Fall of the error of frequencies or damping ratios, of the specimens that have it, by which an effect shows."""
KINDS = ("rig", "group", "specimen", "null")
"""Whose the planted effect is, in turn; of `null` nobody's."""
KEYS = {
    "rig": ("clamp_mass", "clamp_inertia_two", "stinger_mass", "stinger_spring", "clamp_inertia_four"),
    "group": ("pressure_exponent", "contact_offset", "contact_direction", "contact_loss", "adhesive_edges"),
    "specimen": ("adhesive_edges", "lost_contact_middle", "lost_contact_ends", "weld_seam", "contact_direction"),
    "null": (),
}
"""What may be planted: what a rig, a treatment, and one stack can have."""


@dataclass(frozen=True, kw_only=True)
class PooledCase:
    """One case and what was said of it.

    Attributes
    ----------
    seed, kind
        As drawn.
    planted : dict
        By the second model's key, with values.
    members : tuple of int
        Specimens that have it.
    truth : str
        Effect of the catalogue that is meant; empty of none.
    verdict : str
        Of the diagnosis.
    named : tuple of (str, str, tuple of str)
        Effects of the best explanation, their levels, and the specimens that have them.
    left : tuple of tuple of (str, str)
        Effects and levels of all explanations that are not told apart.
    odd : tuple of str
        Specimens that are called odd.
    shows : bool
        Whether the planted effect, as the catalogue has it, lowers errors of those that have it to `SHOWN`.
    alone : bool, optional
        Of an effect of the rig: whether the first specimen by itself would have been given its name, first of all.
    """

    seed: int
    kind: str
    planted: dict[str, dict[str, float]]
    members: tuple[int, ...]
    truth: str
    verdict: str
    named: tuple[tuple[str, str, tuple[str, ...]], ...]
    left: tuple[tuple[tuple[str, str], ...], ...]
    odd: tuple[str, ...]
    shows: bool
    alone: bool | None

    @property
    def specimens(self) -> tuple[str, ...]:
        """Names of those that have what was planted."""
        return tuple(f"S{s + 1}" for s in self.members)

    @property
    def right(self) -> bool:
        """Whether effect and level lead, or nothing is named where nothing is."""
        if not self.truth:
            return not self.named
        return (self.truth, self.kind, self.specimens) in self.named

    @property
    def effect_named(self) -> bool:
        """Whether the effect that was planted is named, at whatever level."""
        return any(effect == self.truth for effect, _, _ in self.named)


def drawn(seed: int, kind: str) -> tuple[dict[str, dict[str, float]], tuple[int, ...]]:
    """Return what is planted, and in which specimens."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    keys = KEYS[kind]
    if not keys:
        return {}, ()
    key = keys[rng.integers(len(keys))]
    order = rng.permutation(N_SPECIMEN).tolist()
    members = {"rig": order, "group": order[: N_SPECIMEN // 2], "specimen": order[:1]}[kind]
    return {key: draw_strength(rng, key)}, tuple(sorted(members))


def specimens_of(
    seed: int,
    planted: dict[str, dict[str, float]],
    members: Sequence[int],
    world: SecondModel,
    number: int = N_SPECIMEN,
) -> list[Specimen]:
    """Return so many specimens; half of them, those of a group if there is one, have a treatment."""
    treated = members if len(members) == number // 2 else range(0, number, 2)
    stack, found = model.read_stack(STACK), []
    for s in range(number):
        plan = Plan(
            seed=max(10, number) * seed + s,
            model_key="layered",
            kind="single",
            planted=planted if s in members else {},
            band=SETUPS["shipped"].band,
        )
        note = {"treatment": "lacquered" if s in treated else "none"}
        found.append(Specimen(name=f"S{s + 1}", stack=stack, tested=tuple(simulated(plan, world)[1]), notes=note))
    return found


def shared_model() -> Callable[..., CandidateModel]:
    """Return `candidate_model`, which is computed once: all cases have the same stack and points."""
    kept: list[CandidateModel] = []

    def reduced(*given: object) -> CandidateModel:
        if not kept:
            kept.append(candidate_model(*given))  # type: ignore[arg-type]  # handed on as they come
        return kept[0]

    return reduced


@single_threaded
def solved(
    seed: int,
    kind: str,
    world: SecondModel,
    reduced: Callable[..., CandidateModel],
    lone: Callable[..., CandidateModel],
) -> PooledCase:
    """Simulate a case, diagnose it, and return what was said; `lone` gives the model of a specimen by itself."""
    planted, members = drawn(seed, kind)
    specimens, effects = specimens_of(seed, planted, members, world), model.catalogue()
    whole, impossible = specimens_model(specimens, effects, reduced=reduced)
    found = searched(begin(whole))
    case = judged(seed, kind, planted, members, concluded(str(seed), found, impossible))
    if not case.truth:
        return case
    case = replace(case, shows=_shows(found, case))
    if kind != "rig":
        return case
    first = diagnose(specimens[0].stack, specimens[0].tested, effects, reduced=lone)
    return replace(case, alone=bool(first.set) and case.truth in first.set[0])


def _shows(found: PooledSearch, case: PooledCase) -> bool:
    """Tell whether the planted effect, at its own level, lowers the errors of those that have it to `SHOWN`."""
    name = next(
        name
        for name, one in found.model.meant.items()
        if one.effect == case.truth and one.level.kind == case.kind and one.level.members == case.members
    )
    base, best = found.search.base, found.search.fitted.get(frozenset([name]))
    if best is None:
        terms = [found.model.terms[name]]
        new = [c.starts[-1] for c in coordinates_of(found.model, terms)[base.x.size :]]
        best = explain(found.model, terms, found.search.setting, np.append(base.x, new))
    before, after = (_errors(found, each, case.members) for each in (base, best))
    return any(b < SHOWN * a for a, b in zip(before, after, strict=True))


def _errors(found: PooledSearch, one: Explanation, members: Sequence[int]) -> tuple[float, float]:
    errors = [one.errors[c] for s in members for c in found.model.states_of[s]]
    return (
        float(np.mean(np.abs(np.expm1(-np.concatenate([e.frequency for e in errors]))))),
        float(np.nanmean(np.abs(np.expm1(-np.concatenate([e.damping for e in errors]))))),
    )


def judged(
    seed: int, kind: str, planted: dict[str, dict[str, float]], members: tuple[int, ...], found: PooledDiagnosis
) -> PooledCase:
    """Return a case with what was said of it."""
    return PooledCase(
        seed=seed,
        kind=kind,
        planted=planted,
        members=members,
        truth=next((str(TABLE[key].catalogue) for key in planted), ""),
        verdict=found.verdict,
        named=tuple((one.effect, one.level, one.specimens) for one in found.best.parts),
        left=tuple(tuple((one.effect, one.level) for one in each.parts) for each in found.ranking[: found.left]),
        odd=tuple(one.name for one in found.specimens if one.odd),
        shows=False,
        alone=None,
    )


def study_of(number: int, world: SecondModel, record: Path) -> list[PooledCase]:
    """Run so many cases that are not recorded yet, and return all of them."""
    models = shared_model(), shared_model()
    return study(
        planned(number), lambda seed, kind: solved(seed, kind, world, *models), record, PooledCase,
        lambda one: (one.seed, one.kind),
    )  # fmt: skip


def planned(number: int) -> list[tuple[int, str]]:
    """Return seeds and kinds of so many cases."""
    return [(FIRST_SEED + i, KINDS[i % len(KINDS)]) for i in range(number)]


def figures(cases: Sequence[PooledCase]) -> Iterator[Share]:
    """Yield what the cases say."""
    planted = [one for one in cases if one.truth]
    lone = [one for one in cases if one.kind == "specimen"]
    others = [(one, f"S{s + 1}") for one in cases for s in range(N_SPECIMEN)]
    innocent = [(one, name) for one, name in others if one.kind != "specimen" or name not in one.specimens]

    yield share("effect and its level right", "85 %", [one.right for one in planted])
    yield share("the same, of those that show", "85 %", [one.right for one in planted if one.shows])
    yield share(
        "the same, and nothing else is named", "reported", [one.right and len(one.named) == 1 for one in planted]
    )
    for kind in KINDS[:-1]:
        yield share(
            f"effect and its level right: of the {kind}", "reported", [one.right for one in planted if one.kind == kind]
        )
    yield share("the effect among those named, at any level", "reported", [one.effect_named for one in planted])
    yield share("odd specimen found", "90 %", [one.specimens[0] in one.odd for one in lone])
    yield share("the same, of those that show", "90 %", [one.specimens[0] in one.odd for one in lone if one.shows])
    yield share("others called odd", "at most 5 %", [name in one.odd for one, name in innocent])
    rig = [one for one in cases if one.alone is not None]
    yield share("effects of the rig: named by all six", "reported", [one.effect_named for one in rig])
    yield share("the same, by the first of them alone", "reported", [bool(one.alone) for one in rig])
    yield share("nothing named where nothing is", "reported", [one.right for one in cases if not one.truth])
