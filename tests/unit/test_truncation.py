"""A truncated basis against the one that it was cut from, in soft and stiff contact, and with an effect."""

import dataclasses

import numpy as np
import pytest

import model
from model import Sampled, truncated
from model.reduction.reduced_equations import Further

STACK = model.Stack(
    name="small",
    length=0.3,
    width=0.08,
    height=0.065,
    n_lamina=24,
    material=model.Material(young=2e11, poisson=0.28, density=7650.0),
    contact=model.Contact(G_f=825.0, d_f=5e-11, pressure=320e3, normal_modulus=5e9),
    clamps=(model.Clamp(mass=1.0, x=0.08, y=0.01, distribution="faces", footprint=(0.04, 0.05)),),
    mesh=model.Mesh(n_x=7, n_y=3),
)
N_MODE = 14
POINTS = model.Observation(node=np.array([1]), location=np.zeros((1, 3)), direction=np.eye(3)[:1])


def frequencies(system, G_f):
    modes = model.solve_modes(system, G_f=G_f, d_f=0.0, n_mode=N_MODE, observation=POINTS, by=())
    return modes.elastic().frequency


def test_soft_modes_keep_their_frequency():
    """Softer contact than the nominal: there the torsion mode has next to no share of a mass-weighted basis."""
    system = model.reduce(STACK, G_f_range=(60.0, 6000.0), n_mode=N_MODE, n_snapshot=6)
    samples = [{"G_f": G_f} for G_f in np.geomspace(60.0, 6000.0, 6)]
    small = truncated(system, [Sampled(samples=samples, parameter=("G_f",))], N_MODE, 0.05)
    assert small.size < 0.8 * system.size
    for G_f in (60.0, 90.0, 800.0, 6000.0):
        np.testing.assert_allclose(frequencies(small, G_f), frequencies(system, G_f), rtol=6e-4)


def test_a_truncated_basis_stays_orthonormal():
    """Enrichment relies on it."""
    system = model.reduce(STACK, n_mode=N_MODE, n_snapshot=3)
    small = truncated(system, [Sampled(samples=[{"G_f": 500.0}, {"G_f": 2000.0}])], N_MODE, 0.05)
    mass = small.matrix("M", small.theta)
    np.testing.assert_allclose(mass, np.eye(small.size), atol=1e-9)


@pytest.fixture(scope="module")
def parted():
    """A stack whose clamps may be heavier or turn, each with modes of its own."""
    effects = model.find_effects(["clamp_mass", "clamp_inertia"])
    system = model.reduce(STACK.with_effects(*effects), G_f_range=(400.0, 4000.0), n_mode=N_MODE)
    stiffness = [{"G_f": G_f} for G_f in np.geomspace(400.0, 4000.0, 5)]
    apart = [
        Sampled(
            samples=[
                {**at, **corner} for at in stiffness for corner in effect.combinations(lambda p: p.trials(5))
            ],
            parameter=tuple(p.name for p in effect.parameters),
        )
        for effect in effects
    ]
    return truncated(system, [Sampled(samples=stiffness), *apart], N_MODE, 0.05)


@pytest.mark.parametrize(
    "moved",
    [
        {},
        {"clamp_added_mass": 1.2},
        {"clamp_roll_inertia": 0.01, "clamp_station": 0.3},
        {"clamp_roll_inertia": 0.01, "clamp_station": 0.3, "clamp_added_mass": 1.2},
    ],
)
def test_what_modes_need_does_as_well_as_the_whole_basis(parted, moved):
    moved = {"G_f": 1500.0, **moved}
    acting = parted.acting(moved)
    assert acting.equations.size <= (1.0 - 0.1 * (3 - len(moved))) * parted.size
    theta = {"G_f": 1500.0, "d_f": 1e-11, "n_mode": 12, "observation": model.observe(parted, POINTS)}
    rest = {name: value for name, value in moved.items() if name != "G_f"}
    whole = model.solve_modes(parted, **theta, parameters=rest, by=tuple(moved)).elastic()
    seen = dataclasses.replace(
        theta["observation"], reduced_rows=acting.rows(theta["observation"].reduced_rows)
    )
    theta["observation"] = seen
    small = model.solve_modes(acting.equations, **theta, parameters=rest, by=tuple(moved)).elastic()
    np.testing.assert_allclose(small.frequency, whole.frequency, rtol=5e-5)
    slope = np.abs(whole.frequency_gradient).max(axis=0)
    assert np.all(np.abs(small.frequency_gradient - whole.frequency_gradient) <= 2e-3 * slope)
    mass = parted.matrix("M", {**parted.theta, **moved})
    overlap = acting.whole(small.coordinate).T @ mass @ whole.coordinate
    np.testing.assert_allclose(np.abs(np.diag(overlap)), 1.0, atol=2e-4)


def test_a_quick_look_is_one_percent_off_at_most(parted):
    moved = {"G_f": 1500.0, "clamp_roll_inertia": 0.003, "clamp_station": 0.7}
    quick = parted.rough.acting(moved).equations
    assert quick.size < 0.9 * parted.acting(moved).equations.size
    rest = {"G_f": 1500.0, "d_f": 0.0, "n_mode": 12, "by": ()}
    rest["parameters"] = {name: value for name, value in moved.items() if name != "G_f"}
    nothing = model.Observed(
        node=np.zeros(0), direction=np.zeros((0, 3)), rows=None, reduced_rows=np.zeros((0, quick.size))
    )
    found = model.solve_modes(quick, observation=nothing, **rest).elastic().frequency
    whole = model.solve_modes(parted, observation=POINTS, **rest).elastic().frequency
    np.testing.assert_allclose(found, whole, rtol=1e-2)


def test_what_acts_is_made_once_while_the_same_moves(parted):
    """The last alone is kept: many specimens have one model, and each would take as much memory as a third of it."""
    first = parted.acting({"G_f": 1500.0})
    assert parted.acting({"G_f": 900.0}) is first
    parted.acting({"G_f": 900.0, "clamp_added_mass": 0.1})
    assert parted.acting({"G_f": 900.0}) is not first


def test_effects_that_need_nearly_all_of_the_basis_get_all_of_it(parted):
    every = {p.name: p.nominal for effect in parted.stack.effects for p in effect.parameters}
    assert parted.acting({"G_f": 1500.0}).space is not None
    some = dataclasses.replace(
        parted.parts,
        n_spare=2,
        further=tuple(
            dataclasses.replace(own, direction=own.direction[:2, :2]) for own in parted.parts.further
        ),
    )
    assert dataclasses.replace(parted.equations, parts=some).acting(every).space is None


def test_a_part_of_the_rig_is_nearby_without_directions_of_its_own():
    """What acts within a reach is in the core; beyond it there are more directions."""
    further = Further(parameter=("place",), reach=5e-3, direction=np.eye(3, 1))
    nominal = {"place": 0.0}
    assert not further.takes_part({"place": 4e-3}, nominal)
    assert further.takes_part({"place": -6e-3}, nominal)
    assert not further.takes_part({"other": 1.0}, nominal)
