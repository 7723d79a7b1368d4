"""What the workbench computes and writes, without its page."""

import asyncio
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ema.campaign.campaign import read_campaign
from updating.errors import StoreError
from updating.results.store import write_result
from updating.workbench.identification_panel import toggled, write_identification
from updating.workbench.measurement_panel import sources
from updating.workbench.opened import Command, find, followed
from updating.workbench.what_if import STEPS, Knob, Outcome, outcome, outcome_chart, response

DEMO = Path(__file__).parents[2] / "data" / "demo_diagnosis" / "campaign.toml"
G_F = Knob(name="G_f", unit="Pa/Pa", lower=100.0, upper=10_000.0, start=1280.0, logarithmic=True)
MASS = Knob(name="clamp_added_mass", unit="kg", lower=-0.5, upper=1.5, start=0.0, logarithmic=False)


def test_a_slider_goes_over_the_range_in_ratios_or_evenly():
    assert [G_F.value(s) for s in (0, STEPS / 2, STEPS)] == pytest.approx([100.0, 1000.0, 10_000.0])
    assert [MASS.value(s) for s in (0, STEPS / 2, STEPS)] == pytest.approx([-0.5, 0.5, 1.5])
    for knob in (G_F, MASS):
        assert knob.value(knob.step(knob.start)) == pytest.approx(knob.start, abs=4e-3 * knob.upper)
        assert knob.step(2.0 * knob.upper) == STEPS
    assert G_F.text(1279.4) == "1279 Pa/Pa"
    assert MASS.text(0.2) == "200 g"


def test_a_click_takes_a_pole_and_the_next_one_there_drops_it():
    first = toggled(np.empty(0, dtype=complex), 300.0, 0.5)
    assert np.abs(first) / (2 * np.pi) == pytest.approx([300.0])
    assert -first.real / np.abs(first) == pytest.approx([0.005])
    both = toggled(first, 120.0, 1.0)
    assert np.abs(both) / (2 * np.pi) == pytest.approx([120.0, 300.0])
    np.testing.assert_array_equal(toggled(both, 300.3, 0.2), both[:1])


def test_what_the_model_does_now_is_drawn_beside_what_it_did_before():
    def made(model):
        return Outcome(
            measured=np.array([100.0, 200.0]), model=np.array(model), likeness=np.array([0.9, 0.8]),
            mode=np.array([0, 2]), error=0.0, modes=None,
        )  # fmt: skip

    before, now, *_ = outcome_chart(made([101.0, 198.0]), made([100.0, 200.0])).traces
    np.testing.assert_allclose(before["y"], [1.0, -1.0])
    np.testing.assert_allclose(now["y"], [0.0, 0.0], atol=1e-12)
    assert now["x"] == ["1: 100 Hz", "3: 200 Hz"]


@dataclass(frozen=True)
class Solved:
    """Elastic modes of a model at four points."""

    frequency: np.ndarray
    shape: np.ndarray

    def elastic(self):
        return self


def test_what_is_tried_is_paired_near_its_frequency_and_not_with_what_looks_a_little_more_alike_far_above():
    near, above = np.array([[0.9, 0.3], [-0.3, 0.9], [0.3, 0.0], [0.0, 0.3]]), [0.2, 0.97, 0.1, 0.1]
    solved = Solved(np.array([101.0, 102.0, 340.0]), np.column_stack([near, above]))
    tried = SimpleNamespace(
        solved=lambda _: solved, used=np.ones(2, bool), natural=np.ones(1), ratio=np.ones(1),
        measured=SimpleNamespace(frequency=np.array([100.0, 103.0]), shape=np.eye(4, 2, dtype=complex)),
    )  # fmt: skip
    now = outcome(tried, {})
    assert now.likeness[1] < 0.9
    np.testing.assert_array_equal(now.model, [101.0, 102.0])


def test_the_function_of_a_mass_on_a_spring_is_that_of_the_textbook():
    f, xi, mass = 50.0, 0.02, 4.0
    modes = SimpleNamespace(
        frequency=np.array([f]), damping=np.array([xi]), shape=np.array([[mass**-0.5]]), coordinate=np.array([[2.0]])
    )
    force = SimpleNamespace(reduced_rows=np.array([[0.5 * mass**-0.5]]))
    lines = SimpleNamespace(frequency=np.array([20.0, 50.0, 90.0]), quantity="accelerance")
    omega, natural = 2 * np.pi * lines.frequency, 2 * np.pi * f
    expected = -(omega**2) / mass / (natural**2 - omega**2 + 2j * xi * natural * omega)
    np.testing.assert_allclose(response(modes, 0, force, lines), expected)


def test_a_campaign_without_results_is_made_once_and_nothing_is_refused(tmp_path):
    made = []

    def make(file, folder):
        made.append((file, folder))

    (tmp_path / "campaign.toml").write_text("", encoding="utf-8")
    one = find(tmp_path, tmp_path / "out", make)
    assert (one.campaign, one.folder) == (tmp_path / "campaign.toml", tmp_path / "out")
    assert made == [(tmp_path / "campaign.toml", tmp_path / "out")]
    with pytest.raises(StoreError, match="nothing to open; give a campaign file"):
        find(tmp_path / "out", None, make)


def test_results_are_opened_from_another_folder_than_they_were_made_from(tmp_path, monkeypatch):
    named, file = Path("own/campaign.toml"), tmp_path / "own" / "campaign.toml"
    folder = tmp_path / "own" / "out"
    write_result(folder / "campaign.json", replace(read_campaign(DEMO), path=named), inputs=(), options={})
    file.write_text("", encoding="utf-8")
    monkeypatch.chdir("/")
    assert find(folder, None, lambda *_: None).campaign.samefile(file)
    file.unlink()
    with pytest.raises(StoreError, match=r"come from own/campaign.toml, which is not there; open the campaign file"):
        find(folder, None, lambda *_: None)


def test_band_and_order_are_written_and_all_else_in_the_campaign_file_stays(tmp_path):
    path = tmp_path / "campaign.toml"
    text = '# ours\nname = "A"  # a comment\n\n[identification]\nband_Hz = [30, 1100]  # below the third bending\n'
    path.write_text(text, encoding="utf-8")
    write_identification(path, (40.0, 900.0), 30)
    changed = text.replace("[30, 1100]", "[40.0, 900.0]") + "order = 30\n"
    assert path.read_text(encoding="utf-8") == changed
    path.write_text("name = ", encoding="utf-8")
    with pytest.raises(StoreError, match=r"campaign.toml: cannot be read"):
        write_identification(path, (40.0, 900.0), 30)


def test_files_in_the_folder_of_the_campaign_are_named_from_there(tmp_path):
    frf = SimpleNamespace(
        output=SimpleNamespace(node=np.array([1, 2]), name=lambda o: f"{o + 1}+z"),
        run=np.array([0, 0]),
        source=(f"{tmp_path / 'M1' / 'run_01.uff'}: data set 1", "/elsewhere/run_02.uff: data set 1"),
    )
    assert sources(frf, 1, tmp_path) == [f"1+z: run 1, {Path('M1', 'run_01.uff')}: data set 1"]
    assert sources(frf, 2, tmp_path) == ["2+z: run 1, /elsewhere/run_02.uff: data set 1"]


def test_of_lines_of_progress_the_page_keeps_the_last():
    lines = []
    for line in ("began", "identify, 0 of 2 done (1 s)", "identify, 0 of 2 done (2 s)", "M1: done", "fit (1 s)"):
        lines = followed(lines, line)
    assert lines == ["began", "identify, 0 of 2 done (2 s)", "M1: done", "fit (1 s)"]


def test_a_command_says_what_it_does_and_a_stopped_one_ends():
    said, codes = [], []

    async def done(code):
        codes.append(code)

    async def run():
        command = Command(said.append)
        await command.run(["--version"], done)
        assert not command.running
        command.stop()  # where nothing runs

    asyncio.run(run())
    assert codes == [0]
    assert said[-1][0].startswith("lamella ")
