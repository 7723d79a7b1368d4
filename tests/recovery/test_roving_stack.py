"""Sensors that rove over a stack that another model simulates: noise is no mass, and a mass is taken out.

No driving point is measured there, and the sensors move along x and y, too, where nobody measures.
"""

import os

import numpy as np
import pytest

from ema import identify, read_campaign
from ema.identification.identify import identify_frf
from ema.modal.runs import run_changes
from ema.types.frf import FRF, Dofs, Geometry
from tests.independent.campaign import SENSORS, SHAKER, Configuration, Plan, simulate, write_campaign
from tests.independent.layered import Layered
from tests.independent.solid import Solid

pytestmark = pytest.mark.slow
N = SHAKER - 1
MODES = np.array([237.0, 261.6, 370.6, 483.9, 613.3])
SOUND = int(os.environ.get("SETS", "100"))
UP = np.tile([0.0, 0.0, 1.0], (N, 1))


def roved(mass, force_noise):
    """The simulated test with sensors of a mass, kg, its modes as identified and why its runs differ."""
    simulated = simulate(
        Plan(
            seed=0,
            model_key="layered",
            kind="null",
            configurations=(Configuration(name="M1", torque=1.5, pressure=160e3),),
            band=(100.0, 900.0),
            sensor_mass=mass,
            force_noise=force_noise,
            response_noise=2e-3,
        ),
        Layered(),
    )
    frf = FRF(
        frequency=simulated.frequency,
        value=simulated.frf[0].reshape(N, 1, -1),
        quantity="accelerance",
        output=Dofs(node=np.arange(1, SHAKER), direction=UP),
        input=Dofs(node=[SHAKER], direction=UP[:1]),
        run=np.arange(N) // SENSORS,
        source=("simulated",) * N,
    )
    node = np.arange(1, SHAKER + 1)
    geometry = Geometry(node=node, coordinate=simulated.nominal, line=np.empty((0, 2)))
    model = identify_frf(frf, geometry, name="M1")
    assert model.frequency.size == MODES.size  # sensors of 35 g shift sharp modes by several half bandwidths
    true = simulated.modes[0]
    return true.frequency, model, run_changes(model, frf.run, sensors_rove=True)


@pytest.mark.parametrize("force_noise", [2e-3, 1e-2])
def test_noise_of_the_force_is_no_mass(force_noise):
    # 10 of 22 runs were said to disagree by a sensor's mass; none had mass
    _, model, changes = roved(0.0, force_noise)
    assert changes.cause == "none"
    assert model.sensor_shift == ()


@pytest.mark.parametrize(("mass", "shift", "left"), [(2e-3, 4e-4, 5e-5), (35e-3, 3e-3, 3e-4)])
def test_the_mass_of_the_sensors_is_taken_out(mass, shift, left):
    true, model, changes = roved(mass, 2e-3)
    nearest = true[np.argmin(np.abs(true[:, None] - model.frequency), axis=0)]
    loaded = np.abs(model.pole) / (2.0 * np.pi)
    assert changes.cause == "sensor mass"
    assert np.abs(loaded / nearest - 1.0).max() > shift
    np.testing.assert_allclose(model.frequency, nearest, rtol=left)


def findings(seed, folder):
    """What is said of a sound test: verdicts, peaks without a mode, why its runs differ, modes invented."""
    rng = np.random.default_rng([45, seed])
    key, model = (("layered", Layered()), ("solid", Solid()))[seed % 2]
    simulated = simulate(
        Plan(
            seed=seed,
            model_key=key,
            kind="null",
            configurations=(Configuration(name="M1", torque=1.5, pressure=160e3),),
            sensor_mass=0.0,
            force_noise=float(10.0 ** rng.uniform(-3.0, -2.0)),
            response_noise=float(10.0 ** rng.uniform(-3.5, -2.0)),
        ),
        model,
    )
    (found,) = identify(read_campaign(write_campaign(simulated, folder)))
    modes = found.modal_model
    apart = np.abs(simulated.modes[0].frequency / modes.frequency[:, None] - 1.0)
    # few lines in a bandwidth are no fault of what is said
    said = [f"{v.check}: {v.message}" for v in found.verdicts if v.level != "pass" and v.check != "resolution"]
    said += [f"peak at {peak.frequency:.1f} Hz" for peak in modes.unexplained]
    said += [run_changes(modes, found.measurement.frf.run, sensors_rove=True).finding]
    said += [f"no mode at {modes.frequency[i]:.1f} Hz" for i in np.flatnonzero(apart.min(axis=1) > 5e-3)]
    return [each for each in said if each]


def test_in_a_wide_band_close_modes_are_found_and_no_run_is_said_to_differ(tmp_path):
    # poles of their own met what runs lacked of two modes 1 % apart: 14 of 22 were said to disagree by up to 11 %
    assert findings(3, tmp_path) == []


@pytest.mark.benchmark
def test_sound_stacks_have_no_findings(tmp_path, capsys):
    said = [findings(seed, tmp_path / str(seed)) for seed in range(SOUND)]
    with capsys.disabled():
        print(f"\n{SOUND} sound tests of other models, {sum(map(bool, said))} with a finding")
        for seed, each in enumerate(said):
            print(*(f"  {seed}: {one}" for one in each), sep="\n", end="\n" if each else "")
    assert sum(map(bool, said)) <= 0.05 * SOUND
