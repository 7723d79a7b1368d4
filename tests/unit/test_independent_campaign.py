"""Campaigns simulated on a second model: drawn, measured and written; a bar of known modes stands for the model."""

import dataclasses
import json

import numpy as np
import pytest

import ema
from tests.independent.bench import BenchModes
from tests.independent.campaign import (
    DISTURBANCES,
    KINDS,
    Plan,
    TableNoise,
    Tolerances,
    draw,
    modal_tables,
    simulate,
    truth,
    write_campaign,
)
from tests.independent.effects import LACKING

EXACT = Tolerances(**{field.name: 0.0 for field in dataclasses.fields(Tolerances)})
MASS = 20.0
FREQUENCY = np.array([0.0, 300.0, 480.0, 700.0, 2000.0])
SHORT = {"band": (200.0, 800.0), "step": 2.0, "n_mode": len(FREQUENCY)}
FREE = {"force_noise": 0.0, "response_noise": 0.0, "sensor_mass": 0.0}


class Bar:
    """Modes cos(r pi (x / L + 1 / 2)) along z, whose frequencies grow with the pressure."""

    def modes(self, bench, n_mode):
        def shape_at(place):
            shape = np.zeros((len(place), 3, n_mode))
            angle = np.pi * np.outer(place[:, 0] / bench.length + 0.5, np.arange(n_mode))
            shape[:, 2] = np.cos(angle) * np.sqrt(np.where(np.arange(n_mode), 2.0, 1.0) / MASS)
            return shape

        damping = np.where(FREQUENCY, 3e-3, 0.0)
        frequency = FREQUENCY[:n_mode] * (bench.pressure / 320e3) ** 0.1
        return BenchModes(frequency=frequency, damping=damping[:n_mode], shape_at=shape_at)


def short(**other):
    given = {"seed": 1, "model_key": "bar", "kind": "null", "tolerances": EXACT, **SHORT, **FREE, **other}
    return Plan(**given)


def last(simulated):
    return simulated.frf[-1]


@pytest.mark.parametrize("kind", KINDS)
def test_draws_hold_what_their_kind_says(kind):
    plans = [draw(seed, kind, "bar") for seed in range(30)]
    assert {len(one.planted) for one in plans} == {{"single": 1, "lacking": 1, "pair": 2}.get(kind, 0)}
    assert {len(one.disturbances) for one in plans} == {int(kind == "disturbed")}
    keys = {key for one in plans for key in one.planted}
    assert all((key in LACKING) == (kind == "lacking") for key in keys)
    assert draw(7, kind, "bar") == plans[7]


def test_one_seed_gives_one_test():
    first, again = (simulate(short(tolerances=Tolerances(), response_noise=1e-3), Bar()) for _ in range(2))
    other = simulate(short(seed=2, tolerances=Tolerances(), response_noise=1e-3), Bar())
    np.testing.assert_array_equal(first.frf, again.frf)
    assert not np.allclose(first.frf, other.frf)


def test_accelerance_is_that_of_the_modes():
    simulated = simulate(short(), Bar())
    modes, omega = simulated.modes[-1], 2 * np.pi * simulated.frequency[:, None]
    shape = modes.shape_at(simulated.nominal)[:, 2]
    one = 2 * np.pi * modes.frequency
    modal = shape[44] * -(omega**2) / (one**2 - omega**2 + 2j * modes.damping * one * omega)
    np.testing.assert_allclose(last(simulated).reshape(44, -1), shape[:44] @ modal.T, rtol=1e-9)


def test_a_sensor_lowers_frequencies_of_its_run_and_dummies_of_all():
    mass = 0.01
    runs = modal_tables(simulate(short(sensor_mass=mass), Bar()), TableNoise(frequency=0.0, damping=0.0, shape=0.0))
    all_on = modal_tables(
        simulate(short(sensor_mass=mass, dummies=True), Bar()), TableNoise(frequency=0.0, damping=0.0, shape=0.0)
    )
    square = 2.0 / MASS * np.mean(np.cos(np.pi * np.linspace(0, 1, 11)[:, None] * [1, 2, 3]) ** 2, axis=0)
    np.testing.assert_allclose(runs[1].frequency / FREQUENCY[1:4] - 1, -mass * square, rtol=0.02)
    np.testing.assert_allclose(all_on[1].frequency / FREQUENCY[1:4] - 1, -22 * mass * square, rtol=0.05)
    assert np.all(runs[1].frequency_std > 0.0)


def test_noise_is_what_is_said_of_it():
    clean, noisy = simulate(short(), Bar()), simulate(short(force_noise=1e-2, response_noise=1e-2), Bar())
    error = (noisy.frf[0] - clean.frf[0]) / noisy.noise[0]
    np.testing.assert_allclose([error.real.std(), error.imag.std()], 1.0, atol=0.02)


@pytest.mark.parametrize("fault", DISTURBANCES)
def test_each_disturbance_shows_in_what_is_measured(fault):
    right, wrong = (simulate(short(disturbances=faults), Bar()) for faults in ((), (fault,)))
    same = [np.allclose(a, b) for a, b in zip(last(right), last(wrong), strict=True)]
    if fault in ("sensor_turned", "channels_exchanged"):
        assert same.count(False) <= 1
    elif fault == "clamps_off":  # a bar has none
        assert wrong.bench[0].clamps[0].x - right.bench[0].clamps[0].x == pytest.approx(5e-3)
    elif fault == "length_wrong":  # a bar's modes scale with it
        assert wrong.bench[0].length / right.bench[0].length == pytest.approx(1.01)
    else:
        assert not any(same)


def test_modal_tables_have_the_scatter_that_they_state():
    noise = TableNoise(frequency=2e-4, damping=0.02, shape=5e-3)
    exact, found = (
        modal_tables(simulate(short(), Bar()), one)[0]
        for one in (TableNoise(frequency=0.0, damping=0.0, shape=0.0), noise)
    )
    error = (found.shape - exact.shape) / found.shape_std
    assert error.std() == pytest.approx(1.0, abs=0.15)
    np.testing.assert_allclose(found.frequency_std, 2e-4 * exact.frequency)
    assert np.all(np.abs(found.frequency - exact.frequency) < 5 * found.frequency_std)


def test_modes_that_nobody_sees_are_left_out():
    assert len(modal_tables(simulate(short(band=(200.0, 2500.0)), Bar()))[0].frequency) == 4
    assert len(modal_tables(simulate(short(), Bar()))[0].frequency) == 3


def test_what_is_written_reads_as_what_was_played(tmp_path):
    simulated = simulate(short(tolerances=Tolerances(), response_noise=1e-3, force_noise=1e-3), Bar())
    file = write_campaign(simulated, tmp_path / "test")
    campaign = ema.read_campaign(file)
    assert [one.name for one in campaign.configurations] == ["M1", "M2"]
    given = json.loads((tmp_path / "test" / "truth.json").read_text())
    assert given["configurations"] == json.loads(json.dumps(truth(simulated)))["configurations"]
    assert np.shape(given["configurations"][0]["shape"]) == (44, 3)
    rows = np.loadtxt(tmp_path / "test" / "M2" / "run_03.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(rows[:, 1] + 1j * rows[:, 2], simulated.frf[1][2, 0], rtol=1e-5)
    assert np.all((rows[:, 3] > 0.0) & (rows[:, 3] <= 1.0))
    assert np.median(rows[:, 3]) > 0.99
