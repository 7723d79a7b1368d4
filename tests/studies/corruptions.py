"""What is said of measurements that were spoiled in every way of `corruptions`: cases, their record, and a table.

The campaigns lack nothing and were made by the layered model of `tests.independent`, so that a physical effect that is
named comes from the corruption alone.
"""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from threadpoolctl import threadpool_limits

import model
from ema import (
    Campaign,
    Measurement,
    ModalModel,
    Verdict,
    check,
    compare,
    content_digests,
    contradicted,
    identify_frf,
    read_campaign,
    read_measurement,
    shared_functions,
    usable,
)
from tests.independent.campaign import Plan, simulate, write_campaign
from tests.independent.layered import Layered
from tests.recovery.corruptions import CORRUPTIONS, spoil
from tests.studies.runner import BLIND, study
from updating.correlation.rig_check import check_rig
from updating.diagnosis.answer import Diagnosis
from updating.diagnosis.cached_model import cached_model
from updating.diagnosis.diagnosis import diagnose
from updating.errors import LAMELLA_ERRORS
from updating.fitting.fit import G_F_BOUNDS, stack_in_state

Outcome = Literal["named", "harmless", "refused", "wrong"]
OUTCOMES: tuple[Outcome, ...] = ("named", "harmless", "refused", "wrong")
FIRST_SEED, SEEDS = 700_200, 5
RECORD = BLIND / "corruptions.jsonl"
"""Of these seeds; the page of promises counts it."""
BAND, STEP = (100.0, 1150.0), 1.0
_NO_FINDING = ("resolution",)
"""Checks that say nothing of a corruption: the step of the study's functions is coarse."""
_BLIND = "too few points or modes"


@dataclass(frozen=True, kw_only=True)
class Case:
    """One spoiled measurement and what was said of it.

    Attributes
    ----------
    kind, seed
        How it was spoiled, and of which campaign.
    outcome : Outcome
        A finding names that something is wrong, or an effect is named with the warning that a wrong statement in the
        stack file does the same; nothing is named and nothing is missing; an error ends the answer, or what is missing
        is unlike anything; or a physical effect is named with confidence, whether or not points that the diagnosis put
        right are reported beside it.
    said : str
        The first finding, the error, or the effects.
    """

    kind: str
    seed: int
    outcome: Outcome
    said: str


def write_sound(seed: int, folder: Path) -> None:
    """Write a campaign that lacks nothing, measured as it should be."""
    plan = Plan(
        seed=seed,
        model_key="layered",
        kind="null",
        band=BAND,
        step=STEP,
        force_noise=2e-3,
        response_noise=2e-3,
        sensor_mass=1e-3,
    )
    write_campaign(simulate(plan, Layered()), folder)


def run(kind: str, seed: int, sound: Path) -> Case:
    """Spoil a copy of a sound campaign, and say what comes of it."""
    with TemporaryDirectory() as temporary, threadpool_limits(1, user_api="blas"):
        folder = Path(temporary) / "campaign"
        shutil.copytree(sound, folder)
        spoil(folder, kind, seed)
        try:
            outcome, said = _answered(folder)
        except LAMELLA_ERRORS as error:
            outcome, said = "refused", str(error).replace(str(folder), "")
    return Case(kind=kind, seed=seed, outcome=outcome, said=said[:200])


def _answered(folder: Path) -> tuple[Outcome, str]:
    """Return what is said of a campaign; the diagnosis is asked where nothing was found before."""
    campaign = read_campaign(folder / "campaign.toml")
    assert campaign.stack is not None
    measured = [read_measurement(campaign, one.name) for one in campaign.configurations]
    checks = [check(one, campaign.identification.band) for one in measured]
    models = [_identified(one, found) for one, found in zip(measured, checks, strict=True)]
    found = [*_findings(checks), *_of_campaign(campaign, measured, models), *_of_rig(campaign, models)]
    if found:
        return "named", found[0].replace(str(folder), "")
    stack = model.read_stack(campaign.stack)
    tested = [
        (one.name, stack_in_state(stack, one).contact.pressure, modes)
        for one, modes in zip(campaign.configurations, models, strict=True)
    ]
    return _of_diagnosis(diagnose(stack, tested, model.catalogue(), reduced=cached_model))


def _findings(checks: Sequence[tuple[Verdict, ...]]) -> Iterator[str]:
    for verdicts in checks:
        for one in verdicts:
            if one.level != "pass" and one.check not in _NO_FINDING and _BLIND not in one.message:
                yield one.message


def _of_campaign(campaign: Campaign, measured: Sequence[Measurement], models: Sequence[ModalModel]) -> Iterator[str]:
    yield from shared_functions({one.name: content_digests(one.frf) for one in measured})
    yield from contradicted(campaign.configurations, models, compare(models))


def _of_rig(campaign: Campaign, models: Sequence[ModalModel]) -> Iterator[str]:
    assert campaign.stack is not None
    for one, modes in zip(campaign.configurations, models, strict=True):
        stack = stack_in_state(model.read_stack(campaign.stack), one)
        system = _reduced(campaign.stack.read_text(encoding="utf-8"), campaign.stack)
        yield from check_rig(system, stack.contact.pressure, modes, G_F_BOUNDS).findings


@lru_cache(maxsize=2)
def _reduced(text: str, file: Path) -> model.ReducedSystem:
    """Return the reduced model of a stack file, known by its text."""
    return model.reduce(model.read_stack(file), G_f_range=G_F_BOUNDS, n_snapshot=3, n_mode=18)


_KNOWN: dict[tuple[object, ...], ModalModel] = {}


def _identified(measured: Measurement, found: tuple[Verdict, ...]) -> ModalModel:
    """Return the modes of a measurement; of one that was identified before, those."""
    kept = usable(measured, found)
    frf, place = kept.frf, kept.geometry.coordinate.tobytes()
    dofs = tuple(part.tobytes() for one in (frf.output, frf.input) for part in (one.node, one.direction))
    key = (measured.name, content_digests(frf), frf.frequency.tobytes(), frf.quantity, dofs, place)
    if key not in _KNOWN:
        _KNOWN[key] = identify_frf(frf, kept.geometry, name=measured.name)
    return _KNOWN[key]


def _of_diagnosis(found: Diagnosis) -> tuple[Outcome, str]:
    effects = set(found.set[0] if found.set else ())
    if effects - set(found.measurement) - set(found.confounded):
        return "wrong", found.sentences[0]
    if found.mixed_up or effects:
        return "named", found.sentences[0]
    if found.verdict == "unlike anything":
        return "refused", found.sentences[0]
    return "harmless", found.sentences[0]


def study_of(seeds: Sequence[int], record: Path) -> list[Case]:
    """Run the cases that are not recorded yet, and return all of them."""

    def made(seed: int, kind: str) -> Case:
        return run(kind, seed, Path(_sound(seed).name))

    return study(
        [(seed, kind) for seed in seeds for kind in CORRUPTIONS], made, record, Case,
        lambda one: (one.seed, one.kind),
        say=lambda one: print(f"{one.outcome:9s} {one.kind}: {one.said[:100]}", flush=True),
    )  # fmt: skip


@lru_cache(maxsize=1)
def _sound(seed: int) -> TemporaryDirectory[str]:
    """Return a folder with the sound campaign of a seed."""
    _KNOWN.clear()
    folder = TemporaryDirectory()
    write_sound(seed, Path(folder.name))
    return folder


def rows(cases: Sequence[Case]) -> list[str]:
    """Return the rows of the table in the documents: how many cases of each outcome, and which were wrong."""
    spoiled = [case for case in cases if case.kind != "none"]
    count = Counter(case.outcome for case in spoiled)
    found = [f"| {name} | {count[name]} = {100 * count[name] / len(spoiled):.1f} % |" for name in OUTCOMES]
    kinds = Counter(case.kind for case in spoiled if case.outcome == "wrong")
    wrong = "; ".join(kind if n == 1 else f"{kind} ({n} times)" for kind, n in kinds.items())
    return [*found, f"| wrong were | {wrong or 'none'} |"]


def table(cases: Sequence[Case]) -> str:
    """Count outcomes over all corruptions, and list what was wrong."""
    spoiled = [case for case in cases if case.kind != "none"]
    kinds = len({case.kind for case in spoiled})
    count = Counter(case.outcome for case in spoiled)
    lines = [f"{kinds} kinds of corruption, {len(spoiled)} cases"]
    lines += [f"{name:9s} {count[name]:4d} = {100 * count[name] / len(spoiled):.0f} %" for name in OUTCOMES]
    lines += [f"wrong: {case.kind} ({case.seed}): {case.said}" for case in spoiled if case.outcome == "wrong"]
    return "\n".join(lines)
