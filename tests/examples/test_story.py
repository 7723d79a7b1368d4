"""The demo: on a test that an independent model simulated, what was planted is found and the error falls."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from ema import ModalModel
from model import catalogue
from updating import read_result
from updating.commands import demo
from updating.commands import diagnose as command
from updating.commands.command_line import app
from updating.diagnosis.answer import Diagnosis
from updating.results.ledger import Ledger

ROOT = Path(__file__).parents[2]
TRUTH = json.loads((ROOT / "data/demo_diagnosis/truth.json").read_text(encoding="utf-8"))


RIVALS = ("pressure_along", "clamp_inertia")
"""Effects that may do to modes what less pressure in the middle does: of the pressure, and of clamps."""


def every_second_run(folder):
    """Copy the shipped campaign with half of its runs, and a stack file with a coarser mesh."""
    shutil.copytree(ROOT / "data/demo_diagnosis", folder)
    file, sign = folder / "campaign.toml", "[[configuration.run]]"
    states = [state.split(sign) for state in file.read_text(encoding="utf-8").split("[[configuration]]")]
    file.write_text("[[configuration]]".join(sign.join([head, *runs[::2]]) for head, *runs in states), encoding="utf-8")
    stack = (folder / "stack.toml").read_text(encoding="utf-8")
    for fine, coarse in (("n_x = 18", "n_x = 12"), ("n_y = 4", "n_y = 2")):
        assert fine in stack
        stack = stack.replace(fine, coarse)
    (folder / "stack.toml").write_text(stack, encoding="utf-8")
    return folder


@pytest.fixture(scope="module", params=["quick", pytest.param("whole", marks=pytest.mark.slow)])
def reported(request, tables_alone, tmp_path_factory):
    """What `lamella demo` prints, and its folder: of half of the runs with few effects, or in more time of all."""
    folder, whole = tmp_path_factory.mktemp("story"), catalogue()
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "quick":
            known = {name: whole[name] for name in ("lost_contact_middle", *RIVALS)}
            patch.setattr(command, "catalogue", lambda _: known)
            shipped = every_second_run(folder / "data")
            patch.setattr(demo, "shipped_data", lambda _: shipped)
        patch.chdir(ROOT)
        done = CliRunner().invoke(app, ["demo", "-o", str(folder)])
    assert done.exit_code == 0, done.output
    return " ".join(done.output.split()), folder


def test_every_mode_is_identified_once(reported):
    """Sensors of 2 g that rove move modes by 0.05 %: one was taken for two."""
    for one in TRUTH["configurations"]:
        modes = read_result(reported[1] / one["name"] / "modal_model.json", ModalModel)
        true = np.array(one["frequency"])[one["visible"]]
        np.testing.assert_allclose(modes.frequency, true, rtol=1e-3)  # with the sensors' mass


def test_what_was_planted_is_identified_and_the_error_falls_on_modes_left_out(reported):
    found = read_result(reported[1] / "diagnosis.json", Diagnosis)
    assert TRUTH["plan"]["planted"].keys() == {"lost_contact_middle"}
    assert (found.verdict, found.set) == ("identified", (("lost_contact_middle",),))
    assert not set(found.ruled_out) & set(found.not_visible)
    before, after = found.ranked(()), found.ranked(("lost_contact_middle",))
    assert before.left_out_error > 0.03
    assert after.left_out_error < 0.1 * before.left_out_error


def test_its_size_is_that_of_the_pressure_that_is_lost(reported):
    """The planted share is of the largest pressure, the catalogue's of the mean: 18 = 6**2 / 2 is the bell's width."""
    share = TRUTH["plan"]["planted"]["lost_contact_middle"]["loss"]
    bell = np.mean(np.exp(-18.0 * np.linspace(-0.5, 0.5, 10_001) ** 2))
    lost = 1.0 - (1.0 - share) / (1.0 - share * bell)
    loss, width = read_result(reported[1] / "diagnosis.json", Diagnosis).ranked(("lost_contact_middle",)).parameter
    assert loss.value == pytest.approx(lost, rel=0.03)
    assert width.value == pytest.approx(1.0 / 6.0, rel=0.05)  # a mesh of half as many elements


def test_it_is_told_in_four_steps_with_a_report(reported):
    text, folder = reported
    for step in ("1. Identify: 9 at M1 and 6 at M2", "2. Fit G_f", "3. Diagnose: Identified", "4. Add it"):
        assert step in text
    assert (folder / "report.html").stat().st_size > 10_000


def test_the_table_of_each_configuration_shows_the_error_with_what_was_added(reported):
    found = read_result(reported[1] / "diagnosis.json", Diagnosis)
    text = (reported[1] / "report.html").read_text(encoding="utf-8")
    tables = re.findall(r"<h4[^>]*>Modes, measured and modelled</h4>(.*?)</table>", text, re.DOTALL)
    shown = [
        float(cell)
        for table in tables
        for cell in re.findall(r'data-of="with what was identified \[%\]"[^>]*>([^<]*)<', table)
    ]
    assert len(tables) == 2
    np.testing.assert_allclose(shown, [100.0 * one.explained for one in found.errors], atol=0.0051)


def test_the_fit_with_the_effect_has_the_numbers_of_the_diagnosis(reported):
    found = read_result(reported[1] / "diagnosis.json", Diagnosis)
    entries = read_result(reported[1] / "ledger.json", Ledger).entry
    for entry, effects in zip(entries, ((), ("lost_contact_middle",)), strict=True):
        one = found.ranked(effects)
        assert (entry.error, entry.mode_error, entry.damping_error, entry.chi_square) == (
            one.frequency_error, one.left_out_error, one.damping_error, one.misfit,
        )  # fmt: skip
        assert entry.shared == one.parameter
