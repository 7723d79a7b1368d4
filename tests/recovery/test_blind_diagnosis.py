"""The blind benchmark of the diagnosis, `make blind`: sealed cases, resumable, scored when all are done."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from updating.blind import jobs as blind_jobs
from updating.blind.case import Case, run
from updating.blind.figures import figures
from updating.blind.jobs import figures_table, planned, run_blind
from updating.commands.command_line import app
from updating.errors import StoreError

ROOT = Path(__file__).parents[2]
SPECIFICATION = ROOT / "data" / "demo_stack" / "virtual_test.toml"


@pytest.mark.blind
def test_blind_cases(capsys):
    with capsys.disabled():
        console = Console(width=100)
        cases = run_blind(SPECIFICATION, ROOT / "out" / "blind", console)
        console.print(figures_table(cases))
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
    at = next(i for i, own in enumerate(found) if own.name.startswith("another's name"))
    assert [(own.hits, own.total) for own in found[at : at + 2]] == [(1, 3), (2, 3)]


def test_cases_go_on_after_the_last_whole_line(tmp_path, monkeypatch):
    """All but the last case are done; of that one half a line was written when the run was killed."""
    lines = [json.dumps(asdict(case(*which))) + "\n" for which in planned()]
    record = tmp_path / "cases.jsonl"
    record.write_text("".join(lines[:-1]) + lines[-1][:40], encoding="utf-8")
    asked = []

    def run(specification, seed, kind):
        asked.append((seed, kind))
        return case(seed, kind)

    monkeypatch.setattr(blind_jobs, "run", run)
    found = run_blind(SPECIFICATION, tmp_path, Console(quiet=True))
    assert asked == [planned()[-1]]
    assert found == tuple(case(*which) for which in planned())
    assert record.read_text(encoding="utf-8") == "".join(lines)


def test_an_interrupted_run_prints_the_figures_of_what_is_done(tmp_path, monkeypatch):
    def run(specification, seed, kind):
        raise KeyboardInterrupt

    monkeypatch.setattr(blind_jobs, "run", run)
    lines = [json.dumps(asdict(case(*which))) + "\n" for which in planned()[:-1]]
    (tmp_path / "cases.jsonl").write_text("".join(lines), encoding="utf-8")
    printed = CliRunner().invoke(app, ["blind", str(SPECIFICATION), "-o", str(tmp_path)])
    assert printed.exit_code == 130
    assert "133 blind cases" in printed.output


def test_the_full_study_begins_with_the_quick_one():
    quick, full = planned(), planned(full=True)
    assert (len(quick), len(full)) == (134, 1300)
    assert full[:134] == quick
    one = [seed for seed, kind in full if kind in ("single", "withheld", "model-form error")]
    assert len(set(one)) == len(one) == 54 + 24 + 10 + 506 + 186 + 90


def test_a_record_of_another_version_is_named(tmp_path):
    (tmp_path / "cases.jsonl").write_text('{"seed": 1, "kind": "null"}\n', encoding="utf-8")
    with pytest.raises(StoreError, match=r"cases\.jsonl, line 1: .*another version.*move it away"):
        run_blind(SPECIFICATION, tmp_path, Console(quiet=True))
