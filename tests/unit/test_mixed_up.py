"""Points of a measurement that were mixed up are identified and corrected; clean data stay as they are."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from updating.diagnosis.points import correct

N_DOF, N_MODE, NAMES = 16, 4, ("M1", "M2")
NODE = np.arange(101, 101 + N_DOF)
STD, SIZE = 2e-3, 0.02
PLACE = np.linspace(0.0, np.pi, N_DOF)
EVERY = np.column_stack([np.cos((k + 2) * PLACE) for k in range(N_MODE + 2)])
EVERY /= np.linalg.norm(EVERY, axis=0)


@dataclass(frozen=True)
class Modes:
    shape: Any
    shape_std: Any
    sensor: Any


@dataclass(frozen=True)
class Configuration:
    name: str
    modes: Modes


def shapes(seed):
    """Return the shapes of both configurations: modes mixed with their neighbours, and noise."""
    rng = np.random.default_rng(seed)
    mixing = np.eye(N_MODE + 2)[:, :N_MODE] + SIZE * rng.standard_normal((N_MODE + 2, N_MODE))
    return [EVERY @ mixing + STD * rng.standard_normal((N_DOF, N_MODE)) for _ in NAMES]


def corrected(measured, nodes=(NODE, NODE)):
    """Return the configurations as they were measured, as they are corrected, and what was mixed up."""
    scatter = np.full((N_DOF, N_MODE), STD) * (1.0 + np.arange(N_DOF))[:, None]
    tested = tuple(
        Configuration(name, Modes(one.astype(complex), scatter, np.arange(N_DOF) % 2))
        for name, one in zip(NAMES, measured, strict=True)
    )
    length = [np.linalg.norm(one, axis=0) for one in measured]
    states = [SimpleNamespace(shape=one / n) for one, n in zip(measured, length, strict=True)]
    modal = SimpleNamespace(rows=EVERY[:, :N_MODE], beyond_rows=EVERY[:, N_MODE:], eigenvalue=np.ones(N_MODE))
    local = SimpleNamespace(modal=lambda x, state: modal)
    noise = [STD / n for n in length]
    found, mixed_up = correct(SimpleNamespace(states=states), local, np.zeros(1), noise, tested, nodes)
    return tested, found, mixed_up


@pytest.mark.parametrize("seed", range(5))
def test_clean_data_stay_as_they_are(seed):
    tested, found, mixed_up = corrected(shapes(seed))
    assert mixed_up is None
    assert found == tested


def test_a_sensor_that_reads_nothing_keeps_its_factor():
    dead = shapes(1)
    for one in dead:
        one[5] = 0.0
    _, found, mixed_up = corrected(dead)
    assert mixed_up is None or 106 not in mixed_up.node
    assert all(np.all(one.modes.shape[5] == 0.0) for one in found)


@pytest.mark.parametrize(("where", "names"), [((1,), ("M2",)), ((0, 1), NAMES)])
@pytest.mark.parametrize("seed", range(3))
def test_two_points_that_were_exchanged_are_put_right(seed, where, names):
    right = shapes(seed)
    wrong = [one.copy() for one in right]
    for c in where:
        wrong[c][[3, 8]] = wrong[c][[8, 3]]
    _, found, mixed_up = corrected(wrong)
    assert (mixed_up.kind, mixed_up.configuration, mixed_up.node) == ("exchanged", names, (104, 109))
    assert mixed_up.log_odds > 10.0
    for c, one in enumerate(found):
        np.testing.assert_array_equal(one.modes.shape.real, right[c])
        swapped = c in where
        assert (one.modes.shape_std[3, 0] == 9.0 * STD) == swapped  # scatter goes with its value
        assert one.modes.sensor[3] == (0 if swapped else 1)


@pytest.mark.parametrize("where", [(0,), (0, 1)])
def test_a_sensor_that_was_turned_over_is_put_right(where):
    right = shapes(7)
    wrong = [one.copy() for one in right]
    for c in where:
        wrong[c][5] *= -1.0
    _, found, mixed_up = corrected(wrong)
    assert (mixed_up.kind, mixed_up.node) == ("turned", (106,))
    assert mixed_up.configuration == tuple(NAMES[c] for c in where)
    for one, expected in zip(found, right, strict=True):
        np.testing.assert_array_equal(one.modes.shape.real, expected)


@pytest.mark.parametrize("factor", [2.0, 0.5, 1.2])
@pytest.mark.parametrize("where", [(0,), (0, 1)])
def test_a_sensor_that_reads_by_a_factor_too_much_is_put_right(where, factor):
    right = shapes(7)
    wrong = [one.copy() for one in right]
    for c in where:
        wrong[c][5] *= factor
    _, found, mixed_up = corrected(wrong)
    assert (mixed_up.kind, mixed_up.node) == ("scaled", (106,))
    assert mixed_up.configuration == tuple(NAMES[c] for c in where)
    assert mixed_up.factor == pytest.approx(factor, rel=0.05)
    for one, expected in zip(found, right, strict=True):
        np.testing.assert_allclose(one.modes.shape.real[5], expected[5], rtol=0.05)


def test_points_that_differ_between_configurations_are_mixed_up_in_one_alone():
    wrong = shapes(8)
    for one in wrong:
        one[5] *= -1.0
    mixed_up = corrected(wrong, (NODE, NODE + 1))[2]
    assert len(mixed_up.configuration) == 1
