"""The ledger of effects: an effect that is there lowers the error on data held out, one that is not does not."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from model import read_stack
from model.stack import Mesh
from updating.effect_jobs import ledger_table
from updating.ledger import ledger
from updating.prepared import prepare, solve_target
from updating.target import target_of_table

ROOT = Path(__file__).parents[2]
CLASSES = ("torsion 1", "bending 1", "bending 2", "torsion 2")


@pytest.fixture(scope="module")
def entries():
    stack = read_stack(ROOT / "data/pirnat2013/stack_C1.toml")
    stack = dataclasses.replace(stack, n_lamina=40, mesh=Mesh(n_x=8, n_y=2)).with_effects(
        "clamp_inertia", "fill_factor"
    )
    blank = [
        target_of_table(stack.with_contact(pressure=p), CLASSES, np.full(4, 500.0), name=name)
        for name, p in (("M1", 160e3), ("M2", 320e3))
    ]
    prepared = []
    for one in prepare(blank, n_snapshot=3):
        values = {"clamp_roll_inertia": 0.004, "clamp_station": 0.7, "G_f": 1200.0}
        modes, column = solve_target(one, values, ())
        target = dataclasses.replace(one.target, frequency=modes.frequency[column])
        prepared.append(dataclasses.replace(one, target=target))
    return ledger(prepared, ["clamp_inertia", "fill_factor"])


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


def test_the_table_has_a_line_for_each(entries):
    table = ledger_table(entries)
    assert table.row_count == len(entries)
    assert list(table.columns[0].cells)[1] == "base + clamp_inertia"
