"""`lamella diagnose` on a campaign with a reference: whether it changed, what, and where."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import ema
from tests.command import lamella
from updating.results.store import read_result
from updating.results.what_changed import WhatChanged

sys.path.insert(0, str(Path(__file__).parents[1] / "recovery"))
from reference_plate import DENSITY, LENGTH, POISSON, THICKNESS, WIDTH, YOUNG, Edge, measured

pytestmark = pytest.mark.usefixtures("all_undrawn")
EDGE = Edge(translation=1e7, rotation=3e3)
PLACE = (0.08, 0.06)
MASS = 0.15
STACK = f"""
name = "plate"
length_mm = {1e3 * LENGTH}
width_mm = {1e3 * WIDTH}
height_mm = {1e3 * THICKNESS}
n_lamina = 1
[material]
young_GPa = {1e-9 * YOUNG}
poisson = {POISSON}
density_kg_m3 = {DENSITY}
[mesh]
n_x = 9
n_y = 6
[[supports]]
edge = "left"
condition = "clamped"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a campaign of a plate held along its left edge, with and without a mass on it."""
    folder = tmp_path_factory.mktemp("plate")
    states = {
        "before": measured(EDGE, seed=1),
        "again": measured(EDGE, seed=2),
        "same": measured(EDGE, seed=3),
        "heavier": measured(EDGE, seed=4, mass=(*PLACE, MASS)),
    }
    text = '[campaign]\nname = "plate"\n[structure]\nstack = "stack.toml"\n'
    text += '[points]\nfile = "points.csv"\nunit = "m"\n'
    for name, modes in states.items():
        ema.write_modes_csv(folder / f"{name}_modes.csv", modes)
        ema.write_shapes_csv(folder / f"{name}_shapes.csv", modes)
        text += f'[[configuration]]\nname = "{name}"\nmodes = "file"\ninput = "35+z"\npressure_kPa = 100\n'
        text += f'files = ["{name}_modes.csv", "{name}_shapes.csv"]\n'
        text += 'repeat_of = "before"\n' if name == "again" else ""
        text += 'compare_to = "before"\n' if name in ("same", "heavier") else ""
    geometry = states["before"].geometry
    rows = zip(geometry.node.tolist(), geometry.coordinate.tolist(), strict=True)
    points = ["node,x,y,z", *(f"{n},{x},{y},{z}" for n, (x, y, z) in rows)]
    (folder / "points.csv").write_text("\n".join(points) + "\n")
    (folder / "stack.toml").write_text(STACK)
    (folder / "campaign.toml").write_text(text)
    return folder


def test_a_mass_on_a_plate_is_named_and_placed_and_a_repeat_is_not(folder):
    done = lamella("diagnose", folder / "campaign.toml", "-o", folder / "out")
    assert done.returncode == 0, done.stderr
    said = " ".join(done.stdout.split())
    assert "heavier against before and again: changed: " in said
    assert "heavier, what and where: a mass that was added" in said
    assert "same against before and again: no mode by itself shows a change" in said
    assert "same, what and where: nothing to place" in said
    assert said.index("heavier against") < said.index("same against")  # what changed comes first
    found = read_result(folder / "out/heavier/what_changed.json", WhatChanged)
    one = found.kind("added_mass")
    assert found.left[0] == "added_mass"
    assert one.place[:2] == pytest.approx(PLACE, abs=0.1 * WIDTH)
    assert 0.8 * one.lower < MASS < 1.2 * one.upper
    assert found.reference == ("before", "again")
    assert "lost_contact" in found.impossible
    assert lamella("report", folder / "out").returncode == 0
    page = (folder / "out/report.html").read_text()
    assert "What changed in heavier, and where" in page
    assert "probability of each cell of the plan" in page
    assert page.index("heavier, what and where") < page.index("same against before")


def test_without_a_stack_file_it_says_whether_it_changed_and_what_to_add(folder):
    text = (folder / "campaign.toml").read_text().replace('[structure]\nstack = "stack.toml"\n', "")
    (folder / "plain.toml").write_text(text)
    done = lamella("diagnose", folder / "plain.toml", "-o", folder / "plain")
    assert done.returncode == 0, done.stderr
    assert "heavier against before and again: changed: " in " ".join(done.stdout.split())
    assert 'takes a model: add stack = "stack.toml" under [structure]' in " ".join(done.stdout.split())
