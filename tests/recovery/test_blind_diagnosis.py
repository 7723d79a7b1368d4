"""The blind benchmark of the diagnosis, `make blind`: sealed cases, resumable, scored when all are done."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from tests.studies.__main__ import STUDIES
from tests.studies.blind import SPECIFICATION, Case, planned, run, study_of
from tests.studies.blind_figures import figures
from tests.studies.runner import line, recorded, study
from updating.errors import StoreError


@pytest.mark.blind
def test_blind_cases(capsys, request):
    with capsys.disabled():
        cases = study_of(planned(), request.config.rootpath / "out/blind/cases.jsonl")
        print("\n".join(one.row for one in figures(cases)))
    alarms = figures(cases)[0]
    assert alarms.interval[0] <= 0.05, "more false alarms than 5 %, beyond what chance explains"


@pytest.mark.blind
@pytest.mark.parametrize("seed", [50030, 51031, 51065, 51066, 65015, 68012, 71048])
def test_a_strong_effect_that_once_was_unlike_anything_is_named(seed):
    """Two lay beyond the modes solved for, four where the reduced basis, one where the mesh was not made for."""
    found = run(SPECIFICATION, seed, "single")
    assert found.verdict == "identified"
    assert found.candidates == (found.truth,)


@pytest.mark.blind
def test_a_pair_is_sought_from_the_better_of_its_effects():
    """A weld seam beside a strong clamp inertia: from the best weld seam alone, the inertia's station is lost."""
    found = run(SPECIFICATION, 60030, "pair")
    assert found.verdict == "identified"
    assert found.candidates == (found.truth,)


@pytest.mark.blind
@pytest.mark.parametrize(("seed", "kind"), [(89019, "single"), (89000, "pair")])
def test_modes_that_the_base_model_lacks_are_those_of_the_effect(seed, kind):
    """Of a waviness one mode at each torque, of a strong clamp inertia with a sensor four resemble none of the base."""
    found = run(SPECIFICATION, seed, kind)
    assert found.verdict == "identified"
    assert tuple(sorted(found.candidates[0])) == found.truth


def case(seed, kind, stiffness=1.5e8, ruled_out=()):
    return Case(
        seed=seed, kind=kind, truth=("clamp_rods",), values={"rod_stiffness": stiffness}, verdict="one of",
        candidates=(("clamp_rods",), ("stinger_mass", "weld_seam")), ruled_out=ruled_out, not_visible=(),
        covered=(True,), distance=6.0, rival=float("inf"), most_visible=("stinger_mass",), bic=(),
        held_out=(9.0, 1.2, 1.0), held_out_frequency=(0.01, 0.002, 0.001),
    )  # fmt: skip


def test_a_planted_effect_is_ruled_out_wrongly_only_at_its_usual_strength():
    """What is ruled out is the nominal strength, 1e8 N/m, or more; a weaker effect may be there."""
    right, weak, wrong = (
        case(1, "single"),
        case(2, "single", stiffness=2e7, ruled_out=("clamp_rods",)),
        case(3, "single", ruled_out=("clamp_rods", "weld_seam")),
    )
    (figure,) = (f for f in figures((right, weak, wrong)) if "ruled out" in f.name)
    assert (figure.hits, figure.total) == (1, 2)


def test_names_for_a_withheld_effect_are_counted_beside_those_of_bic():
    named = case(1, "withheld")
    refused = replace(named, verdict="unlike anything", candidates=(), bic=("stinger_mass",))
    found = figures((named, refused, refused))
    at = next(i for i, one in enumerate(found) if one.name.startswith("another's name"))
    assert [(one.hits, one.total) for one in found[at : at + 2]] == [(1, 3), (2, 3)]


def test_cases_go_on_after_the_last_whole_line(tmp_path):
    """All but the last case are done; of that one half a line was written when the run was killed."""
    lines = [line(case(*which)) for which in planned()]
    record = tmp_path / "cases.jsonl"
    record.write_text("".join(lines[:-1]) + lines[-1][:40], encoding="utf-8")
    asked = []

    def run(*which):
        asked.append(which)
        return case(*which)

    found = study(planned(), run, record, Case, lambda one: (one.seed, one.kind))
    assert asked == [planned()[-1]]
    assert found == [case(*which) for which in planned()]
    assert record.read_text(encoding="utf-8") == "".join(lines)


def test_cases_that_are_run_side_by_side_come_in_the_order_of_the_plan(tmp_path):
    with ThreadPoolExecutor(4) as executor:
        found = study(planned(), case, tmp_path / "new/cases.jsonl", Case, lambda one: (one.seed, one.kind), executor)
    assert [(one.seed, one.kind) for one in found] == list(planned())
    assert len(recorded(tmp_path / "new/cases.jsonl", Case)) == 134


def test_a_study_goes_on_from_the_command_line(tmp_path, monkeypatch):
    record = tmp_path / "cases.jsonl"
    record.write_text("".join(line(case(*which)) for which in planned()[:3]), encoding="utf-8")
    rows, _ = STUDIES["blind"]
    assert rows(3, record) == [one.row for one in figures([case(*which) for which in planned()[:3]])]


def test_the_full_study_begins_with_the_quick_one():
    quick, full = planned(), planned(full=True)
    assert (len(quick), len(full)) == (134, 1300)
    assert full[:134] == quick
    one = [seed for seed, kind in full if kind in ("single", "withheld", "model-form error")]
    assert len(set(one)) == len(one) == 54 + 24 + 10 + 506 + 186 + 90


def test_a_record_of_another_version_is_named(tmp_path):
    (tmp_path / "cases.jsonl").write_text('{"seed": 1, "kind": "null"}\n', encoding="utf-8")
    with pytest.raises(StoreError, match=r"cases\.jsonl, line 1: .*another version.*move it away"):
        recorded(tmp_path / "cases.jsonl", Case)
