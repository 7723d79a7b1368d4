"""The page of promises: tests that it names are there, and its counts are those of the tests."""

import re
from pathlib import Path

from tests.examples import test_every_key, test_fault_points
from tests.recovery import corruptions, damaged_readers
from tests.studies import corruptions as corruptions_study
from tests.studies.runner import recorded
from tests.unit import test_bad_input

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/promises.md").read_text(encoding="utf-8")


def test_tests_that_are_named_are_there():
    named = set(re.findall(r"`(tests/[\w/]+\.py)`", PAGE))
    assert len(named) > 8
    for name in named:
        assert re.search(r"^def test_", (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert set(re.findall(r"`make ([\w-]+)`", PAGE)) <= set(targets)


def test_counts_are_those_of_the_tests():
    keys = {
        (form, key)
        for whole in test_every_key.FORMS
        for form in test_every_key.every_form(whole)
        for key in form.model_fields
    }
    counted = {
        "wrong inputs that a command names": len(test_bad_input.TABLE),
        "keys of files, each used by a command": len(keys),
        "readers whose inputs are mutated": len(damaged_readers.READERS),
        "kinds of corrupted measurements": len(corruptions.CORRUPTIONS) - 1,
        f"writes of {len(test_fault_points.N_WRITE)} commands, each with {len(test_fault_points.FAULTS)} faults": sum(
            test_fault_points.N_WRITE.values()
        ),
        "tasks of a pool, at each of which a worker is killed": test_fault_points.N_ITEM,
    }
    said = {what: int(count) for count, what in re.findall(r"^\| (\d+) \| (.*?) \|$", PAGE, re.MULTILINE)}
    assert said == counted


def test_the_table_of_corruptions_says_what_was_recorded():
    cases = recorded(corruptions_study.RECORD, corruptions_study.Case)
    seeds = range(corruptions_study.FIRST_SEED, corruptions_study.FIRST_SEED + corruptions_study.SEEDS)
    assert [(case.seed, case.kind) for case in cases] == [(s, k) for s in seeds for k in corruptions.CORRUPTIONS]
    assert all(case.outcome == "harmless" for case in cases if case.kind == "none")  # nothing was spoiled
    lines = PAGE.splitlines()
    start = lines.index(f"| of {len(corruptions.CORRUPTIONS) - 1} kinds, five campaigns | cases |") + 2
    found = corruptions_study.rows(cases)
    assert lines[start : start + len(found)] == found
