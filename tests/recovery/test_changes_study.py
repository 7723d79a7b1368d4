"""The question what changed on pairs that second models made: part of `make blind`, resumable."""

from pathlib import Path

import pytest

from tests.studies.changes import RECORD, Laboratory, Pair, figures, kinds_of, structure_of, study_of
from tests.studies.runner import recorded

OUT = "out/blind/changes.jsonl"
NUMBER = 40
"""Laboratories, each with one state that has not changed and two that have."""


def pair(**given):
    made = {
        "seed": 1, "state": 1, "structure": "plate", "planted": "added mass", "values": {"mass": 0.02}, "moved": 5.0,
        "scatter": 2e-3, "place": (0.1, 0.0), "size": 0.02, "seen": True, "verdict": "identified",
        "left": ("added_mass",), "kind_place": (0.11, 0.01, 0.0), "kind_size": (0.021, 0.018, 0.024), "part": "",
        "right": ("added_mass",), "sentences": (),
    }  # fmt: skip
    return Pair(**(made | given))


def shares(pairs):
    return {one.name: (one.hits, one.total) for one in figures(pairs)}


def test_what_is_right_wrong_placed_and_sized_is_counted():
    wrong = pair(left=("hole", "crack"), kind_place=(-0.2, 0.0, 0.0), kind_size=())
    found = shares([pair(), wrong])
    assert found["one change: kind right or in the set"] == (1, 2)
    assert found["one change: named, and not one of the names is right"] == (1, 2)
    assert found["location within a tenth of the length, of those named"] == (1, 2)
    assert found["intervals of 90 % hold the size"] == (1, 1)


def test_a_change_below_three_scatters_is_not_counted_and_nothing_named_of_nothing_is_right():
    none = pair(planted="", moved=0.0, left=(), verdict="unchanged", seen=False, right=())
    found = shares([pair(moved=2.0), none])
    assert found["one change: changed"] == (0, 0)
    assert found["no change: changed or named"] == (0, 1)


def test_all_kinds_come_in_turn():
    drawn = {(structure_of(seed), kind) for seed in range(60) for kind in kinds_of(seed, structure_of(seed))}
    assert len(drawn) == 25


def test_the_page_has_the_figures_of_the_record():
    page = (Path(__file__).parents[2] / "docs/changes.md").read_text(encoding="utf-8")
    for one in figures([pair for laboratory in recorded(RECORD, Laboratory) for pair in laboratory.pairs]):
        assert one.row.split(" | ")[1] in page
    bolts = [pair for one in recorded(RECORD.with_name("loose_bolts.jsonl"), Laboratory) for pair in one.pairs]
    *_, right = figures(bolts)
    assert right.row.split(" | ")[1] in page


@pytest.mark.blind
def test_pairs_of_second_models(capsys, request):
    """Every figure is printed; of false alarms no more are left than chance explains."""
    with capsys.disabled():
        pairs = study_of(NUMBER, request.config.rootpath / OUT)
        for one in figures(pairs):
            print(one.row, flush=True)
    hits, total = shares(pairs)["no change: named"]
    assert hits <= 0.1 * total
