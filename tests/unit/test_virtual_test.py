"""A virtual test: what stands on the bench, masses that are added, poles, averages, files."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ema
import model
from tests.studies import modal_data
from tests.studies.modal_data import ModalNoise, simulate_modes
from updating.errors import FitError
from updating.results.store import digest
from updating.virtual.campaign import (
    Dynamics,
    dynamics,
    loaded_response,
    poles,
    simulate,
    true_modes,
    write_virtual_test,
)
from updating.virtual.vibration_test import Averaging, drawn_deviations, read_virtual_test, specimens

ROOT = Path(__file__).parents[2]

STACK = """
name = "small"
length_mm = 300
width_mm = 60
height_mm = 40
n_lamina = 12
[material]
young_GPa = 200
poisson = 0.28
density_kg_m3 = 7650
[contact]
G_f = 1500
d_f_s_per_Pa = 1e-11
pressure_kPa = 160
normal_modulus_GPa = 1
"""
SPECIFICATION = """
[campaign]
name = "small"
[structure]
stack = "stack.toml"
mesh = [8, 2]
[points]
n_station = 3
[shaker]
place_mm = [-130, 20, -20]
force_cell_mass_g = 10
stinger_N_m = 2000
[measurement]
band_Hz = [300, 2000]
step_Hz = 5
averages = 8
force_noise = 0.01
response_noise = 0.02
sensor_mass_g = 5
format = "csv"
seed = 7
[[configuration]]
name = "M1"
torque_Nm = 1.5
pressure_kPa = 160
[[configuration]]
name = "M2"
torque_Nm = 3
pressure_kPa = 320
[[effect]]
name = "contact_loss"
values = { contact_eta = 0.005 }
[deviation]
torque = [0.05, -0.05]
[spread]
density = 0.01
reassembly = 0.02
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("test")
    (path / "stack.toml").write_text(STACK, encoding="utf-8")
    (path / "spec.toml").write_text(SPECIFICATION, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def test(folder):
    return read_virtual_test(folder / "spec.toml")


@pytest.fixture(scope="module")
def bench(test):
    specimen = specimens(test)[0]
    return specimen, model.reduce(specimen.stack)


REDUCED = {}


@pytest.fixture
def reduced_once(monkeypatch):
    """Reduce each stack once for all tests that ask for the same; what differs among them comes after."""
    anew = model.reduce

    def kept(stack, **settings):
        key = digest({"stack": stack, **settings})
        if key not in REDUCED:
            REDUCED[key] = anew(stack, **settings)
        return REDUCED[key]

    monkeypatch.setattr(model, "reduce", kept)


@pytest.fixture
def coarse(monkeypatch):
    """Draw modal data on a coarse mesh: what is asked of them is asked of any."""
    monkeypatch.setattr(modal_data, "QUICK_MESH", model.Mesh(n_x=10, n_y=3))


def test_the_bench_holds_what_was_given_and_what_the_seed_draws(test):
    first, second = specimens(test)
    assert first.configuration.pressure == pytest.approx(1.05 * 160e3)
    assert second.configuration.pressure == pytest.approx(0.95 * 320e3)
    drawn = drawn_deviations(test)
    assert first.stack.material.density == pytest.approx(7650 * (1 + drawn["density"][0]))
    assert first.configuration.G_f == pytest.approx(1500 * (1 + drawn["reassembly"][0]))
    assert first.configuration.G_f != second.configuration.G_f
    assert drawn == drawn_deviations(test)
    assert drawn != drawn_deviations(replace(test, seed=8))
    assert first.stack.effect_values["contact_eta"] == 0.005
    assert test.stack.effects == ()


def test_sensors_that_load_the_stack_equal_a_heavier_stack(bench):
    specimen, system = bench
    of = dynamics(system, system.theta)
    at = specimen.output
    sensors = model.observe(system, replace(at, node=at.node[:2], location=at.location[:2], direction=at.direction[:2]))
    rows, frequency = sensors.reduced_rows, np.array([400.0, 812.0, 1555.0])
    drive = model.observe(system, specimen.shaker).reduced_rows[0]

    def response(which):
        return np.array([rows @ np.linalg.solve(which.at(2j * np.pi * f), drive) for f in frequency]).T

    found = loaded_response(of, response(of), frequency, sensors, np.zeros(2, int), 0.2)
    expected = response(of.with_parts(rows, 0.2))
    np.testing.assert_allclose(found, expected, rtol=1e-8)
    assert np.abs(expected / response(of) - 1).max() > 0.05


def test_dummies_make_all_runs_see_one_heavier_stack(bench, test):
    specimen, system = bench
    heavy = replace(test, dummy_masses=True, sensor_mass=0.05)
    true = true_modes(heavy, specimen, system)
    assert np.ptp(true.run_frequency, axis=0).max() == 0.0
    assert np.all(true.tested_frequency[:3] < 0.99 * true.frequency[:3])
    roving = true_modes(replace(heavy, dummy_masses=False), specimen, system)
    assert np.ptp(roving.run_frequency, axis=0)[:3].min() > 0.01


def test_a_pole_that_is_met_to_the_last_bit_is_found():
    undamped = Dynamics(steady={"M": np.eye(2), "C": np.zeros((2, 2)), "K": np.diag([1.0, 4.0])}, following=())
    found, _ = poles(undamped, np.array([1j, 2j]), np.eye(2))
    np.testing.assert_allclose(found, [1j, 2j], rtol=1e-12)


def test_functions_without_noise_have_the_true_poles(test, reduced_once):
    one = replace(
        test, configurations=test.configurations[:1], deviation={}, dummy_masses=True, averaging=None, noise=0.0
    )
    frf, true = simulate(replace(one, step=1.0))["M1"]
    measured = ema.identify_frf(frf, test.geometry, name="M1", band=(400.0, 1900.0))
    strongest = int(np.argmax(np.where(true.visible((500.0, 1700.0)), true.strength, 0.0)))
    near = int(np.argmin(np.abs(measured.frequency - true.tested_frequency[strongest])))
    assert measured.frequency[near] == pytest.approx(true.tested_frequency[strongest], rel=1e-6)
    assert measured.damping[near] == pytest.approx(true.tested_damping[strongest], rel=1e-3)


def test_poles_are_those_of_the_complex_eigenproblem(test):
    specimen = specimens(replace(test, effects=(), effect_values={}))[0]
    system, c = model.reduce(specimen.stack), specimen.configuration
    modes = model.solve_modes(system, G_f=c.G_f, d_f=c.d_f, n_mode=10, observation=specimen.output).elastic()
    start = 2 * np.pi * modes.frequency * (1j - modes.damping)
    found, _ = poles(dynamics(system, system.theta), start, modes.coordinate)
    frequency, damping = model.complex_modes(system, G_f=c.G_f, d_f=c.d_f, n_mode=10)
    np.testing.assert_allclose(np.sort(np.abs(found)) / 2 / np.pi, frequency, rtol=1e-9)
    np.testing.assert_allclose(np.sort(-found.real / np.abs(found)), np.sort(damping), rtol=1e-5, atol=1e-9)


def test_poles_of_frequency_dependent_stacks_are_those_of_their_own_frequency(test, bench):
    specimen, system = bench
    true = true_modes(replace(test, force_cell_mass=0.0, stinger_stiffness=0.0), specimen, system)
    c = specimen.configuration
    modes = model.solve_modes(system, G_f=c.G_f, d_f=c.d_f, observation=specimen.output, n_mode=10).elastic()
    np.testing.assert_allclose(true.frequency[:4], modes.frequency, rtol=1e-4)
    np.testing.assert_allclose(true.damping[:4], modes.damping, rtol=2e-3)
    plain = model.solve_modes(
        system, G_f=c.G_f, d_f=c.d_f, observation=specimen.output, n_mode=10, parameters={"contact_eta": 0.0}
    ).elastic()
    assert np.all(true.damping[:3] > plain.damping[:3] + 1e-3)


def test_averages_without_noise_give_the_clean_functions(test, reduced_once):
    one = replace(test, configurations=test.configurations[:1], deviation={})
    exact = replace(one, averaging=Averaging(n_average=4, force_noise=0.0, response_noise=0.0))
    clean = replace(one, averaging=None, noise=0.0)
    for (a, _), (b, _) in zip(simulate(exact).values(), simulate(clean).values(), strict=True):
        np.testing.assert_allclose(a.value, b.value, rtol=1e-10)
        np.testing.assert_allclose(a.coherence, 1.0, rtol=1e-10)


def test_the_scatter_of_h1_is_that_of_its_coherence(test, reduced_once):
    averaging = Averaging(n_average=64, force_noise=0.01, response_noise=0.02)
    one = replace(test, configurations=test.configurations[:1], deviation={}, averaging=averaging)
    clean = simulate(replace(one, averaging=None, noise=0.0))["M1"][0].value
    frf = simulate(one)["M1"][0]
    relative = np.abs(frf.value / clean - 1) ** 2
    n = averaging.n_average
    predicted = (1 - frf.coherence) / (n * frf.coherence)  # Bendat and Piersol, table 9.6, both parts
    good = frf.coherence > 0.9
    assert np.mean(relative[good]) == pytest.approx(np.mean(predicted[good]), rel=0.1)


def test_files_are_read_back_as_simulated_and_the_same_seed_gives_the_same_bytes(folder, test):
    test = replace(test, configurations=test.configurations[:1], deviation={})
    write_virtual_test(test, folder / "one")
    write_virtual_test(test, folder / "two")
    files = sorted(p.relative_to(folder / "one") for p in (folder / "one").rglob("*") if p.is_file())
    assert len(files) == 6 + 4
    for file in files:
        assert (folder / "one" / file).read_bytes() == (folder / "two" / file).read_bytes(), file
    campaign = ema.read_campaign(folder / "one/campaign.toml")
    assert model.read_stack(campaign.stack).effects == ()
    for name, (frf, _) in simulate(test).items():
        read = ema.read_measurement(campaign, name).frf
        np.testing.assert_allclose(read.value, frf.value, rtol=1e-3)
        np.testing.assert_allclose(read.coherence, frf.coherence, atol=1e-5)
        np.testing.assert_array_equal(read.output.node, frf.output.node)
        np.testing.assert_array_equal(read.run, frf.run)
    truth = json.loads((folder / "one/truth.json").read_text(encoding="utf-8"))["result"]
    assert truth["effects"] == ["contact_loss"]
    text = "".join((folder / "one" / f).read_text(encoding="utf-8") for f in files if f.name != "truth.json")
    assert "contact_loss" not in text


def test_modal_data_scatter_as_stated(test, reduced_once, coarse):
    one = replace(test, configurations=test.configurations[:1], deviation={}, spread={})
    noise = ModalNoise(frequency=1e-3, damping=0.05, shape=0.02)
    measured, true = simulate_modes(one, noise)["M1"]
    seen = true.visible(one.band)
    assert measured.frequency.size == seen.sum() >= 2
    np.testing.assert_allclose(measured.frequency, true.tested_frequency[seen], rtol=5e-3)
    np.testing.assert_allclose(measured.frequency_std, 1e-3 * measured.frequency)
    np.testing.assert_allclose(np.diag(ema.mac(measured.shape, true.shape[:, seen])), 1.0, atol=0.01)
    again, _ = simulate_modes(one, noise)["M1"]
    np.testing.assert_array_equal(again.shape, measured.shape)


def test_the_sign_of_a_solver_does_not_change_what_is_drawn(test, monkeypatch, reduced_once, coarse):
    one = replace(test, configurations=test.configurations[:1], deviation={}, spread={})
    drawn, _ = simulate_modes(one, ModalNoise())["M1"]

    def turned(*given):
        true = true_modes(*given)
        return replace(true, shape=-true.shape)

    monkeypatch.setattr("tests.studies.modal_data.true_modes", turned)
    again, _ = simulate_modes(one, ModalNoise())["M1"]
    np.testing.assert_array_equal(again.shape, drawn.shape)


def test_upper_modes_are_true_as_well(test, coarse):
    """Soft contact brings many modes into the band; the reduction must hold for all that are simulated."""
    soft = replace(test.configurations[0], G_f=300.0)
    one = replace(test, configurations=(soft,), deviation={}, spread={}, force_cell_mass=0.0)
    one = replace(one, stinger_stiffness=0.0, sensor_mass=0.0)
    _, true = simulate_modes(one, ModalNoise())["M1"]
    (specimen,) = specimens(replace(one, stack=replace(one.stack, mesh=modal_data.QUICK_MESH)))
    system = model.reduce(specimen.stack, G_f_range=(270.0, 330.0), n_snapshot=2, n_mode=24)
    exact = model.refine(system, G_f=300.0, n_mode=22).frequency[6:]
    np.testing.assert_allclose(true.frequency, exact, rtol=1e-3)


def test_the_truth_is_sealed():
    """Only the module that writes the truth knows the name of its file."""
    naming = [
        path.relative_to(ROOT).as_posix()
        for package in ("ema", "model", "updating")
        for path in (ROOT / package).rglob("*.py")
        if '"truth' in path.read_text(encoding="utf-8")
    ]
    assert naming == ["updating/virtual/campaign.py"]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("torque = [0.05, -0.05]", "torque = [0.05]", "needs 2 value"),
        ("density = 0.01", "densty = 0.01", "densty"),
        ("density = 0.01", "torque = 0.01", "not both"),
        ("averages = 8", "averages = 8\nnoise = 0.01", "either 'noise'"),
        ("contact_eta = 0.005", "eta = 0.005", "contact_eta"),
    ],
)
def test_a_wrong_key_is_named(folder, old, new, expected):
    (folder / "wrong.toml").write_text(SPECIFICATION.replace(old, new), encoding="utf-8")
    with pytest.raises(FitError, match=expected):
        read_virtual_test(folder / "wrong.toml")
