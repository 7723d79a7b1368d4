"""The ledger of effects: an effect that is there lowers the error on data held out, one that is not does not."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from model import find_effects, read_stack
from model.stack.parts import Mesh
from updating.fitting.joint_problem import FitSettings
from updating.fitting.ledger import ledger
from updating.fitting.prepared import prepare, solve_target
from updating.fitting.sensitivity import Scatter
from updating.fitting.target import target_of_table
from updating.results.ledger import ledger_table

ROOT = Path(__file__).parents[2]
CLASSES = ("torsion 1", "bending 1", "bending 2", "torsion 2")


def simulated(effects, values, specimen=""):
    """Two torques of a small stack, with the modes that the model has at these values."""
    stack = read_stack(ROOT / "data/pirnat2013/stack_C1.toml")
    stack = dataclasses.replace(stack, n_lamina=40, mesh=Mesh(n_x=8, n_y=2)).with_effects(
        *find_effects(effects)
    )
    blank = [
        target_of_table(
            stack.with_contact(pressure=p), CLASSES, np.full(4, 500.0), name=name, specimen=specimen
        )
        for name, p in (("M1", 160e3), ("M2", 320e3))
    ]
    prepared = []
    for one in prepare(blank, n_snapshot=3):
        modes, column = solve_target(one, values, ())
        target = dataclasses.replace(
            one.target, frequency=modes.frequency[column], damping=modes.damping[column]
        )
        prepared.append(dataclasses.replace(one, target=target))
    return prepared


@pytest.fixture(scope="module")
def entries():
    values = {"clamp_roll_inertia": 0.004, "clamp_station": 0.7, "G_f": 1200.0}
    return ledger(
        simulated(["clamp_inertia", "fill_factor"], values),
        ["clamp_inertia", "fill_factor"],
        FitSettings(damping=False),
    )


@pytest.fixture(scope="module")
def torques():
    """One stack at two torques, whose stiffness and loss grow with the root of the pressure."""
    values = {"exponent": 0.5, "G_f": 1200.0, "d_f": 5e-11}
    return ledger(
        simulated(["pressure_exponent"], values, "S"),
        ["pressure_exponent"],
        FitSettings(scatter=Scatter(pressure=0.03)),
    )


def test_the_effect_that_is_there_explains_all(entries):
    base, right, wrong, both = entries
    assert [e.effects for e in entries] == [
        (), ("clamp_inertia",), ("fill_factor",), ("clamp_inertia", "fill_factor"),
    ]  # fmt: skip
    assert base.error > 0.05
    assert right.error < 1e-4
    assert right.mode_error < 1e-3
    assert right.configuration_error < 1e-4
    assert both.chi_square < 1e-3
    assert wrong.error > 0.5 * base.error
    assert wrong.mode_error > 0.5 * base.mode_error


def test_two_torques_of_one_stack_show_the_pressure_law(torques):
    base, law = torques
    assert law.error < 1e-3
    assert law.mode_error < 1e-3
    assert base.error > 5 * law.error
    assert base.mode_error > 5 * law.mode_error
    assert (
        base.configuration_error > 0.1
    )  # n = 1 predicts 41 % more frequency at twice the pressure, here 19 %
    assert law.shared[0].value == pytest.approx(0.5, abs=0.02)
    nominal = [np.sqrt(p.lower * p.upper) for p in base.pressure]
    assert abs(base.pressure[0].value / nominal[0] - 1.0) > 0.09  # the base model takes it for a torque error
    assert all(abs(p.value / f - 1.0) < 0.01 for p, f in zip(law.pressure, nominal, strict=True))


def test_what_one_torque_cannot_determine_predicts_no_other(torques):
    _, law = torques
    assert np.isnan(law.configuration_error)
    table = ledger_table(torques)
    assert list(table.columns[3].cells)[1] == "- | -"
    assert "do not determine" in table.caption


def test_the_table_has_a_line_for_each(entries):
    table = ledger_table(entries)
    assert table.row_count == len(entries)
    assert list(table.columns[0].cells)[1] == "base\n+ clamp rotary inertia (clamp_inertia)"
