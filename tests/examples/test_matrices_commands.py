"""The shipped model of another program, from the command line: its hidden mass, and what needs a stack says so."""

import json
import re
import shutil

import numpy as np
import pytest

from tests.command import ROOT, lamella
from updating.report import page
from updating.report.change_part import kind_table
from updating.report.modes_part import modes_section
from updating.results.store import read_result
from updating.results.what_changed import WhatChanged

EXAMPLE = ROOT / "data/matrices_example"
pytestmark = pytest.mark.usefixtures("all_undrawn")


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plate")
    return folder, [lamella_in_tables(name, EXAMPLE / "campaign.toml", "-o", folder) for name in ("fit", "diagnose")]


def lamella_in_tables(*words):
    """Run a command whose page has the tables of a configuration alone; `lamella report` draws all of it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "configuration_section", lambda tested, _, added: modes_section(tested, added))
        return lamella(*words)


def test_the_hidden_mass_is_found(done):
    folder, (fitted, diagnosed) = done
    assert (fitted.returncode, diagnosed.returncode) == (0, 0), fitted.stderr + diagnosed.stderr
    assert "root_springs" in fitted.stdout
    said = " ".join(diagnosed.stdout.split())
    assert said.startswith("Identified: a mass at corner (mass_at_corner)")
    value, low, high = (float(v) for v in re.search(r"= ([\d.]+) g \(95 %: ([\d.]+) g to ([\d.]+) g\)", said).groups())
    assert low - 0.5 < 45.0 < high + 0.5
    assert value == pytest.approx(45.0, rel=0.03)
    made = lamella("report", folder)
    assert made.returncode == 0, made.stderr
    text = (folder / "report.html").read_text()
    assert "a mass at corner" in text
    assert "root_springs" in text
    added = lamella_in_tables("fit", EXAMPLE / "campaign.toml", "-o", folder, "--effect", "mass_at_corner")
    assert added.returncode == 0, added.stderr
    assert "mass_at_corner" in added.stdout


def test_modes_of_the_model_are_listed(tmp_path):
    found = lamella("model", EXAMPLE / "structure.toml", "-o", tmp_path, "-n", 3)
    assert found.returncode == 0, found.stderr
    assert "total mass 1.20576 kg" in found.stdout
    assert "32.7254" in found.stdout


@pytest.mark.slow
def test_what_changed_is_named_and_of_a_repeat_nothing_is(tmp_path):
    done = lamella("diagnose", EXAMPLE / "changes.toml", "-o", tmp_path)
    assert done.returncode == 0, done.stderr
    said = " ".join(done.stdout.split())
    assert "control against before and again: no mode by itself shows a change" in said
    assert "control, what and where: nothing to place" in said
    assert "after, what and where: a mass that was added" in said
    truth = json.loads((EXAMPLE / "truth.json").read_text())["change"]
    found = read_result(tmp_path / "after/what_changed.json", WhatChanged)
    one = found.kind("added_mass")
    assert found.verdict == "identified"
    assert one.place[:2] == pytest.approx(1e-3 * np.array(truth["at_mm"]), abs=0.01)
    assert one.lower < truth["added_kg"] < one.upper
    assert one.part.startswith("node ")
    cell = kind_table(found).rows[0][3]  # as exact as the sentence says, "x = 80 ± 2 mm"
    assert f"x = {cell} mm" in said
    made = lamella("report", tmp_path)
    assert made.returncode == 0, made.stderr
    assert "What changed in after, and where" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize("command", ["next-test"])
def test_what_needs_a_stack_says_so(tmp_path, command):
    found = lamella(command, EXAMPLE / "campaign.toml", "-o", tmp_path)
    assert found.returncode == 1
    assert "is a structure of matrices" in " ".join(found.stderr.split())


def test_a_first_structure_file_is_written(tmp_path):
    for name in ("plate.sti.gz", "plate.mas.gz", "plate.dof", "plate.inp", "plate.uff", "points.csv"):
        shutil.copy(EXAMPLE / name, tmp_path / name)
    found = lamella("new", tmp_path)
    assert found.returncode == 0, found.stderr
    file = tmp_path / "structure.toml"
    assert 'stack = "structure.toml"' in (tmp_path / "campaign.toml").read_text()
    asked = lamella("model", file, "-o", tmp_path / "out")
    assert "matrices.units = '?'" in asked.stderr or "band_Hz" in asked.stderr
    filled = file.read_text().replace('units = "?"', 'units = "mm-t-s"').replace('band_Hz = "?"', "band_Hz = 400")
    file.write_text(filled)
    solved = lamella("model", file, "-o", tmp_path / "out")
    assert solved.returncode == 0, solved.stderr
    assert "6 modes of a rigid" in solved.stdout


def test_a_damaged_structure_file_is_named(tmp_path):
    for file in EXAMPLE.iterdir():
        if file.is_file():
            shutil.copy(file, tmp_path / file.name)
    file = tmp_path / "structure.toml"
    file.write_text(file.read_text().replace('group = "root"\nspring', 'group = "roof"\nspring'))
    found = lamella("fit", tmp_path / "campaign.toml", "-o", tmp_path / "out")
    assert found.returncode == 1
    assert "no group 'roof'" in " ".join(found.stderr.split())
