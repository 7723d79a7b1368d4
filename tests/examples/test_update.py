"""Updating from a file: what comes out of the shipped one, and what is said of one that is wrong."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from model import catalogue
from updating.commands import update as update_command
from updating.commands.terminal import Run
from updating.commands.update import UpdateFile, held_out, parameter_table, read_update_file, run_update
from updating.diagnosis.explained_model import Updated
from updating.errors import FitError
from updating.pooled.joint_fit import joint_fit
from updating.results.store import read_result

ROOT = Path(__file__).parents[2]
SPEC = ROOT / "data/demo_stack/update.toml"


@pytest.fixture(scope="module")
def done(demo, tmp_path_factory):
    """What is made of the identified modes of the demo, with no effects beside: to reduce and search all takes long."""
    folder = tmp_path_factory.mktemp("update")
    shutil.copytree(demo[0], folder, dirs_exist_ok=True)

    def fit(*given, known, **settings):
        assert known.keys() == catalogue().keys()
        return joint_fit(*given, known={}, **settings)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(update_command, "joint_fit", fit)
        return folder, run_update(Run(campaign=SPEC, output=folder, console=Console(quiet=True)))


def test_the_shipped_file_finds_the_pressure_law(done):
    """G_f of the two torques was simulated with 1480 and 911, which is p**0.3."""
    truth = json.loads((ROOT / "data/demo_stack/truth.json").read_text(encoding="utf-8"))["result"]
    (low, high) = truth["configurations"]
    simulated = 1.0 + np.log(high["G_f"] / low["G_f"]) / np.log(2.0)
    fit = done[1].fit
    exponent = next(p for p in fit.parameter if p.name == "exponent")
    assert exponent.value == pytest.approx(simulated, abs=0.01)
    assert exponent.interval[0] < simulated < exponent.interval[1]
    assert fit.value("d_f", "M1") == pytest.approx(low["d_f"], rel=0.01)
    assert fit.value("d_f", "M2") == pytest.approx(high["d_f"], rel=0.01)
    young = next(p for p in fit.parameter if p.name == "young")
    assert young.interval[0] < 1.0 < young.interval[1]


def test_the_error_falls_on_data_used_and_held_out(done):
    fit, (base, law) = done[1].fit, done[1].ledger
    assert fit.error() < 1e-3
    assert fit.error(held_out=True) < 1e-3
    assert [c.used.tolist().count(False) for c in fit.configuration] == [0, 1]
    assert law.error < base.error
    assert max(law.mode_error, base.mode_error) < 1e-3
    assert base.pulled  # without the law, contact is pulled apart from torque to torque
    assert not law.pulled
    assert law.chi_square < base.chi_square
    assert "the contact stiffness G_f would have to be" in base.pulled[0]  # else the base model meets nothing
    assert not law.pulled


def test_what_is_written_is_what_was_found(done):
    folder, result = done
    again = read_result(folder / "update.json", Updated)
    np.testing.assert_array_equal(again.fit.covariance, result.fit.covariance)
    np.testing.assert_array_equal(again.fit.course, result.fit.course)
    with (folder / "correlation.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    np.testing.assert_allclose(np.array([r[1:] for r in rows[1:]], float), result.fit.correlation)
    for name in ("correlation.png", "convergence.png"):
        assert (folder / name).read_bytes().startswith(b"\x89PNG")
    assert parameter_table(result.fit).rows[-1][0] == "exponent"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("effects =", "efects =", "efects: unknown key; did you mean 'effects'"),
        ("bounds =", "bound =", "parameter.G_f.bound: unknown key; did you mean 'bounds'"),
        ('scope = "specimen"', 'scope = "stack"', "parameter.G_f.scope: .*'specimen'.*found 'stack'"),
        ("prior = [1.0, 0.02]", "prior = [1.0, 0.0]", "parameter.young.prior"),
        ("prior = [1.0, 0.02]", "prior = [1.0, 0.02]\nfixed = 1.0", "take out 'fixed' or prior"),
        ('name = "Demo', 'title = "Demo', "name: this key is missing"),
        ("[200, 6000]", "[200, many]", "not a TOML file"),
    ],
)
def test_a_wrong_key_is_named_with_what_would_be_right(tmp_path, old, new, message):
    text = SPEC.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "update.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(FitError, match=message):
        read_update_file(path)


def test_a_start_that_no_fit_takes_is_refused(tmp_path):
    path = tmp_path / "update.toml"
    text = SPEC.read_text(encoding="utf-8").replace("[parameter.G_f] ", "[parameter.G_f]\nstart = 900 ")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FitError, match=r"parameter\.G_f\.start: every fit starts where"):
        read_update_file(path)


def test_an_unknown_configuration_is_said_before_anything_is_identified(tmp_path):
    path = tmp_path / "update.toml"
    text = SPEC.read_text(encoding="utf-8").replace('"M1", "M2"', '"M1", "M3"')
    path.write_text(text.replace("campaign.toml", str(SPEC.parent / "campaign.toml")), encoding="utf-8")
    with pytest.raises(FitError, match="'M3' is unknown; there are M1, M2"):
        run_update(Run(campaign=path, output=tmp_path / "out", console=Console(quiet=True)))
    assert not (tmp_path / "out").exists()


def test_a_mode_that_is_not_there_cannot_be_held_out():
    given = UpdateFile.model_validate({"name": "x", "campaign": [{"file": "a.toml"}], "hold_out": {"6": [5]}})
    with pytest.raises(FitError, match=r"hold_out\.6: there is no mode 5; it has 4"):
        held_out(given, {"6": 4})
