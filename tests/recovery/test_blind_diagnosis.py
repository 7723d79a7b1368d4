"""The blind benchmark of the diagnosis, `make blind`: sealed cases, resumable, scored when all are done."""

import json
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

from updating.blind import Case, run_all
from updating.blind_figures import figures

SPECIFICATION = Path(__file__).parents[2] / "data" / "demo_stack" / "virtual_test.toml"
RECORD = Path(__file__).parents[2] / "out" / "blind" / "cases.jsonl"
FIRST_SEED = 5000  # thresholds were set on seeds below
N_EACH = {"single": 74, "null": 24, "withheld": 12, "pair": 10}
CASES = [  # mixed, so that what is done says something of every kind
    (FIRST_SEED + i + (100 if kind == "withheld" else 0), kind)
    for i in range(74)
    for kind, n in N_EACH.items()
    if i * n // 74 != (i - 1) * n // 74
]


def recorded() -> list[Case]:
    if not RECORD.exists():
        return []
    tupled = ("truth", "not_visible", "covered", "most_visible", "bic", "held_out")
    cases = []
    for line in RECORD.read_text(encoding="utf-8").splitlines():
        raw = json.loads(line)
        raw.update({name: tuple(raw[name]) for name in tupled})
        raw["candidates"] = tuple(map(tuple, raw["candidates"]))
        cases.append(Case(**raw))
    return cases


@pytest.mark.blind
def test_blind_cases(capsys):
    RECORD.parent.mkdir(parents=True, exist_ok=True)
    done = {(c.seed, c.kind) for c in recorded()}
    left = [case for case in CASES if case not in done]
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as workers:
        for i, case in enumerate(run_all(SPECIFICATION, left, workers)):
            with RECORD.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(case)) + "\n")
            with capsys.disabled():
                said = " or ".join(" with ".join(c) for c in case.candidates)
                print(f"{i + 1} of {len(left)}: seed {case.seed}, {case.kind}, {case.truth} ->", end=" ")
                print(case.verdict, said, flush=True)
    cases = recorded()
    sizes = [len(c.candidates) for c in cases if c.kind == "single" and c.candidates]
    with capsys.disabled():
        print(
            f"\nseeds {FIRST_SEED} to {max(c.seed for c in cases)}, mean set size {np.mean(sizes):.2f} (target 1.5)"
        )
        for own in figures(cases):
            low, high = own.interval
            share = 100 * own.hits / own.total if own.total else np.nan
            print(
                f"{own.name:45s} {share:6.1f} % of {own.total:4d} (95 %: {100 * low:.0f} to {100 * high:.0f})"
                f"   target {own.target}"
            )
    alarms = figures(cases)[0]
    assert alarms.interval[0] <= 0.05, "more false alarms than 5 %, beyond what chance explains"
