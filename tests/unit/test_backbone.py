"""Strain of the contact, and a mode over its amplitude: limits, scales and refusals."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import model
from model.contact.contact import SlipLaw
from model.modes.backbone import backbone, chosen_interfaces, contact_strain
from model.stack.parts import Pressing, read_curve

CURVE = read_curve(Path(__file__).parents[2] / "data/contact/compression_standin.csv")
STACK = model.Stack(
    name="stack",
    length=0.3,
    width=0.08,
    height=0.06,
    n_lamina=8,
    material=model.Material(young=200e9, poisson=0.28, density=7650.0),
    contact=model.Contact(pressure=320e3, G_f=800.0, d_f=1e-11, normal_modulus=1e9),
    mesh=model.Mesh(n_x=4, n_y=2),
)
POINT = model.Observation(node=[1], location=[[0.1, 0.02, 0.03]], direction=[[0.0, 0.0, 1.0]])
LAW = SlipLaw(friction=0.2)
GIVEN = {"mode": 1, "G_f": 800.0, "d_f": 1e-11}


@pytest.fixture(scope="module")
def system():
    return model.reduce(STACK, n_snapshot=1)


@pytest.fixture(scope="module")
def strain(system):
    return contact_strain(system)


def energies(system, strain):
    """Energy of the tangential contact of the first elastic modes at unit modulus, by its strain and by its matrix."""
    term = next(t for t in system.terms if t.name == "tangential contact")
    modes = model.solve_modes(system, G_f=800.0, d_f=1e-11, observation=POINT).elastic().coordinate
    by_strain = strain.weight @ np.square(strain.rows @ modes).sum(axis=0)
    return by_strain, np.einsum("ir,ij,jr->r", modes, term.matrix, modes)


def test_strain_carries_the_energy_of_the_tangential_contact(system, strain):
    by_strain, by_matrix = energies(system, strain)
    np.testing.assert_allclose(by_strain, by_matrix, rtol=2e-3)


def test_strain_takes_its_pressure_from_the_field():
    clamp = model.Clamp(mass=0.0, x=0.02, y=0.0, footprint=(0.06, 0.05))
    pressing = Pressing(curve=CURVE, plate_rigidity=1e4)
    system = model.reduce(dataclasses.replace(STACK, clamps=(clamp,), pressing=pressing), n_snapshot=1)
    strain = contact_strain(system)
    density = strain.weight / strain.weight.mean()
    assert density.max() > 5.0 * np.median(density)
    by_strain, by_matrix = energies(system, strain)
    np.testing.assert_allclose(by_strain, by_matrix, rtol=5e-2)


def test_few_interfaces_stand_for_all():
    place, share = chosen_interfaces(239, 9)
    z = np.arange(239) / 238
    for power in range(9):
        assert share @ z[place] ** power == pytest.approx(np.sum(z**power))
    assert np.all(share > 0.0)
    assert chosen_interfaces(5, 9)[0].size == 5


def test_the_linear_model_is_the_limit_of_small_amplitude(system, strain):
    linear = model.solve_modes(system, G_f=800.0, d_f=1e-11, observation=POINT).elastic()
    at_rest = backbone(system, strain, LAW, amplitude=np.zeros(1), **GIVEN)
    assert at_rest.frequency[0] == pytest.approx(linear.frequency[1], rel=1e-13)
    assert at_rest.damping[0] == pytest.approx(linear.damping[1], rel=1e-10)
    small = backbone(system, strain, LAW, amplitude=np.array([1e-14, 1e-12, 1e-10]), **GIVEN)
    lower = 1.0 - small.frequency / at_rest.frequency[0]
    np.testing.assert_allclose(lower[1:] / lower[:-1], 100**0.5, rtol=1e-2)  # as x to the 1 + chi


def test_a_contact_that_hardly_slips_is_the_linear_model(system, strain):
    found = backbone(system, strain, SlipLaw(friction=1e12), amplitude=np.array([0.0, 1e-9]), **GIVEN)
    assert found.frequency[1] == pytest.approx(found.frequency[0], rel=1e-9)
    assert found.damping[1] == pytest.approx(found.damping[0], rel=1e-6)


def test_amplitude_counts_in_units_of_the_friction(system, strain):
    """The slip limit is the only stress of the law: twice the friction, twice the amplitude for the same mode."""
    once = backbone(system, strain, LAW, amplitude=np.array([1e-6]), **GIVEN)
    law = dataclasses.replace(LAW, friction=0.4)
    twice = backbone(system, strain, law, amplitude=np.array([2e-6]), **GIVEN)
    assert once.frequency[0] < 0.99 * backbone(system, strain, LAW, amplitude=np.zeros(1), **GIVEN).frequency[0]
    assert twice.frequency[0] == pytest.approx(once.frequency[0], rel=1e-9)
    assert twice.damping[0] == pytest.approx(once.damping[0], rel=1e-7)
    assert twice.slip[0] == pytest.approx(2.0 * once.slip[0], rel=1e-6)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"amplitude": np.array([2e-6, 1e-6])}, "must be 0 or above and ascend"),
        ({"amplitude": np.array([-1e-6])}, "must be 0 or above and ascend"),
        ({"mode": 99}, "elastic modes are numbered from 0 to"),
    ],
)
def test_what_cannot_be_followed_is_refused(system, strain, wrong, message):
    with pytest.raises(model.SolveError, match=message):
        backbone(system, strain, LAW, **{"amplitude": np.array([1e-6]), **GIVEN, **wrong})


def test_a_mode_that_is_lost_is_refused(system, strain, monkeypatch):
    monkeypatch.setattr("model.modes.backbone._MOST_STEPS", 1)
    with pytest.raises(model.SolveError, match="so much slips that the mode cannot be followed"):
        backbone(system, strain, LAW, amplitude=np.array([1e-5]), **GIVEN)


def test_effects_that_depend_on_frequency_are_refused():
    stack = STACK.with_effects(*model.find_effects(["viscoelastic_contact"]), fraction=0.05)
    system = model.reduce(stack, n_snapshot=1)
    with pytest.raises(model.SolveError, match="depend on frequency"):
        backbone(system, contact_strain(system), LAW, amplitude=np.zeros(1), **GIVEN)
