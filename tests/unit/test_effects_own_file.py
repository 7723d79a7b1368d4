"""An effect in one file of the user's own reaches the virtual test and the fit; nothing else is edited."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from model import read_effect, read_stack
from model.stack.parts import Mesh
from tests.studies.published.shared_opt_G import fit_shared_opt_G
from tests.studies.published.target import prepare, solve_target, target_of_table
from updating.virtual.vibration_test import read_virtual_test, specimens

ROOT = Path(__file__).parents[2]
CLASSES = ("torsion 1", "bending 1", "bending 2", "torsion 2")
TRUE = 4e7
G_F = {"A": 1300.0, "B": 900.0}


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    path = tmp_path_factory.mktemp("own") / "mine.py"
    text = (ROOT / "data/effects_example/gap_spring.py").read_text(encoding="utf-8")
    path.write_text(text.replace("gap_spring", "my_wedge"), encoding="utf-8")
    return path


def test_the_virtual_test_plants_it(tmp_path, mine):
    demo = ROOT / "data/demo_stack"
    text = (demo / "virtual_test.toml").read_text(encoding="utf-8")
    spec = tmp_path / "spec.toml"
    spec.write_text(
        text.replace('"stack.toml"', f'"{demo}/stack.toml"')
        + '\n[[effect]]\nname = "my_wedge"\nvalues = {wedge_modulus = 4e7}\n',
        encoding="utf-8",
    )
    for specimen in specimens(read_virtual_test(spec, [mine])):
        assert "my_wedge" in [effect.name for effect in specimen.stack.effects]
        assert specimen.stack.effect_values["wedge_modulus"] == TRUE


def test_the_fit_finds_its_strength(mine):
    """From frequencies of the model with the effect, at two torques, its strength and both G_f come back."""
    stack = read_stack(ROOT / "data/pirnat2013/stack_C1.toml")
    stack = dataclasses.replace(stack, n_lamina=40, mesh=Mesh(n_x=8, n_y=2)).with_effects(read_effect(mine))
    blank = [
        target_of_table(
            stack.with_contact(pressure=pressure), CLASSES, np.full(4, 500.0), name=name, damping=np.full(4, 0.01)
        )
        for name, pressure in (("A", 160e3), ("B", 320e3))
    ]
    measured = []
    for one in prepare(blank, n_snapshot=3):
        values = {"wedge_modulus": TRUE, "G_f": G_F[one.target.name], "d_f": 1e-10}
        modes, column = solve_target(one, values, ())
        target = dataclasses.replace(one.target, frequency=modes.frequency[column])
        measured.append(dataclasses.replace(one, target=target))
    found = fit_shared_opt_G(measured, ["my_wedge"], left_out=False)
    assert found.parameter[0].value == pytest.approx(TRUE, rel=1e-3)
    assert found.G_f == pytest.approx(G_F, rel=1e-3)
