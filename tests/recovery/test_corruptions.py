"""Corrupted measurements are named, harmless or refused, and hardly ever a physical effect."""

import json
import os
from pathlib import Path

import pytest

from tests.recovery.corruptions import CORRUPTIONS
from tests.studies.corruptions import FIRST_SEED, SEEDS, Case, study_of, table
from tests.studies.runner import recorded

MOST_WRONG = 0.03


def test_there_are_enough_kinds():
    assert len(CORRUPTIONS) - 1 >= 60


def test_a_record_that_was_cut_off_is_read_as_far_as_it_goes(tmp_path):
    record = tmp_path / "record.jsonl"
    line = json.dumps({"kind": "hum", "seed": 1, "outcome": "wrong", "said": "x"})
    record.write_text(f"{line}\n{line[:20]}", encoding="utf-8")
    cases = recorded(record, Case)
    assert cases == [Case(kind="hum", seed=1, outcome="wrong", said="x")]
    assert table(cases).splitlines()[-2:] == ["wrong        1 = 100 %", "wrong: hum (1): x"]


@pytest.mark.benchmark
def test_study_of_corruptions(capsys):
    """It goes on where it stopped: the record is in the folder that LAMELLA_STUDY names, out by default."""
    record = Path(os.environ.get("LAMELLA_STUDY", "out")) / "corruptions.jsonl"
    with capsys.disabled():
        cases = study_of(range(FIRST_SEED, FIRST_SEED + SEEDS), record)
        print(table(cases))
    sound = [case for case in cases if case.kind == "none"]
    assert all(case.outcome == "harmless" for case in sound)
    wrong = sum(case.outcome == "wrong" for case in cases)
    assert wrong <= MOST_WRONG * (len(cases) - len(sound))
