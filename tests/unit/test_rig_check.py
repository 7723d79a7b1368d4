"""A measurement beside its model: a force in the wrong place, a wrong scale, sensors upside down are told apart."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from ema.types.frf import Dofs, Geometry
from model import Contact, Material, Observation, Stack, observe, reduce, solve_modes
from updating.correlation.rig_check import check_rig, upright
from updating.errors import PairingError

RANGE, G_F, PRESSURE = (500.0, 4000.0), 1500.0, 160e3
STACK = Stack(
    name="short",
    length=0.4,
    width=0.06,
    height=0.006,
    n_lamina=12,
    material=Material(young=200e9, poisson=0.28, density=7650.0),
    contact=Contact(G_f=1000.0, d_f=1e-11, pressure=320e3, normal_modulus=1e9),
)
STATIONS = np.linspace(-0.2, 0.2, 7)
POINTS = np.array([[x, y, 0.003] for x in STATIONS for y in (-0.03, 0.03)])
FORCE = np.array([-0.17, 0.02, -0.003])
N = len(POINTS)


@cache
def system():
    return reduce(STACK, G_f_range=RANGE, n_snapshot=2, n_mode=14)


@cache
def true_modes():
    """Return modes at the points and, last, at the force, each shape off by 3 % and each frequency by 1 %."""
    rng = np.random.default_rng(4)
    where = Observation(
        node=np.arange(1, N + 2), location=np.vstack([POINTS, FORCE]), direction=np.tile([0.0, 0.0, 1.0], (N + 1, 1))
    )
    modes = solve_modes(
        system(), G_f=G_F, d_f=0.0, n_mode=14, observation=observe(system(), where), parameters={"pressure": PRESSURE}
    ).elastic()
    seen = np.linalg.norm(modes.shape, axis=0) > 0.1 * np.linalg.norm(modes.shape, axis=0).max()
    shape = modes.shape[:, seen]
    shape = shape + 0.03 * np.sqrt(np.mean(shape**2, axis=0)) * rng.normal(size=shape.shape)
    return modes.frequency[seen] * (1.0 + 0.01 * rng.normal(size=int(seen.sum()))), shape


def measured(factor=1.0, sign=None, force=FORCE):
    """Return what an identification gives where all functions are multiplied by a factor and sensors by signs."""
    frequency, shape = true_modes()
    one = shape[:N] * (np.ones(N) if sign is None else sign)[:, None]
    pole = 2.0 * np.pi * frequency * (-0.002 + 1j)
    return SimpleNamespace(
        name="M1",
        frequency=frequency,
        pole=pole,
        residue=(factor * one * shape[N] / (2j * pole.imag))[:, None, :],
        shape=one.astype(complex),
        node=np.arange(1, N + 1),
        direction=np.tile([0.0, 0.0, 1.0], (N, 1)),
        sensor=np.arange(N) % 2,
        input=Dofs(node=np.array([N + 1]), direction=np.array([[0.0, 0.0, 1.0]])),
        geometry=Geometry(node=np.arange(1, N + 2), coordinate=np.vstack([POINTS, force]), line=np.empty((0, 2), int)),
    )


def checked(**given):
    return check_rig(system(), PRESSURE, measured(**given), RANGE)


def test_a_measurement_as_it_is_stated_has_no_finding():
    found = checked()
    assert found.findings == ()
    assert upright(found) is found
    assert found.force.factor == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("signs", [(-1, 1), (1, -1), (-1, -1)])
def test_a_force_that_is_listed_at_the_wrong_corner_is_named_with_its_place(signs):
    found = checked(force=FORCE * [*signs, 1])
    assert found.force.misplaced
    assert found.force.likely == pytest.approx(FORCE[:2], abs=0.015)
    (said,) = found.findings
    assert "the force does not act where the points file has it" in said


def test_a_force_that_is_ten_millimetres_off_is_not_remarked():
    assert checked(force=FORCE + np.array([0.01, 0.0, 0.0])).findings == ()


@pytest.mark.parametrize(
    ("factor", "said"),
    [(1.0 / 9.80665, "g for m/s² would do this"), (2.0, "times as large"), (-1.0, "the opposite sign to the model's")],
)
def test_functions_that_the_mass_of_the_stack_contradicts_are_named(factor, said):
    (found,) = checked(factor=factor).findings
    assert found.startswith("M1: all functions")
    assert said in found


@pytest.mark.parametrize("sensor", [0, 1])
def test_a_sensor_upside_down_in_all_runs_is_named_and_refused(sensor):
    found = checked(sign=np.where(np.arange(N) % 2 == sensor, -1.0, 1.0))
    assert (found.sensor, found.reads) == (sensor + 1, pytest.approx(-1.0, abs=0.1))
    with pytest.raises(PairingError, match=f"M1: sensor {sensor + 1} of each run seems to be upside down"):
        upright(found)


@pytest.mark.parametrize("sensor", [0, 1])
@pytest.mark.parametrize("reads", [10.0, 1.0 / 9.80665, -0.1])
def test_a_sensor_in_another_unit_in_all_runs_is_named_with_its_factor_and_refused(sensor, reads):
    found = checked(sign=np.where(np.arange(N) % 2 == sensor, reads, 1.0))
    assert (found.sensor, found.reads) == (sensor + 1, pytest.approx(reads, rel=0.1))
    with pytest.raises(PairingError, match=f"M1: sensor {sensor + 1} of each run seems to be .*times .*scale = "):
        upright(found)


@pytest.mark.parametrize("reads", [0.8, 1.3])
def test_a_gain_that_the_diagnosis_knows_is_left_to_it(reads):
    assert checked(sign=np.where(np.arange(N) % 2 == 1, reads, 1.0)).findings == ()


@pytest.mark.parametrize(("pressure", "said"), [(160.0, "0.16 kPa, less than the stack's own weight"), (3e8, "bear")])
def test_a_pressure_in_another_unit_is_named(pressure, said):
    (found,) = check_rig(system(), pressure, measured(), RANGE).findings[:1]
    assert said in found
    assert found.startswith("M1: the pressure between the laminas is stated as")
    assert not any("pressure" in one for one in check_rig(system(), PRESSURE, measured(), RANGE).findings)


def test_two_modes_turn_no_sensor_over():
    """Bending and torsion near each other are each other's shapes with one side turned."""
    one, sign = measured(), np.where(np.arange(N) % 2 == 1, -1.0, 1.0)
    one.frequency, one.pole = one.frequency[:2], one.pole[:2]
    one.residue, one.shape = one.residue[:, :, :2], sign[:, None] * one.shape[:, :2]
    assert check_rig(system(), PRESSURE, one, RANGE).sensor == 0


def test_without_the_place_of_the_force_only_sensors_are_checked():
    one = measured(factor=10.0)
    one.geometry = Geometry(node=np.arange(1, N + 1), coordinate=POINTS, line=np.empty((0, 2), int))
    found = check_rig(system(), PRESSURE, one, RANGE)
    assert found.force is None
    assert found.findings == ()
