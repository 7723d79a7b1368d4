"""What is shared among places of a grid, and a mass that moves along it."""

import dataclasses
from functools import cache

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

import model
from model.effects.parts import shared_among, square
from model.elements.equations import Monomial, Term

GRID = np.linspace(0.0, 1.0, 9)
INSIDE = np.linspace(0.0625, 0.9375, 300)


def shares(positions):
    return np.array([shared_among(float(x), GRID.size) for x in positions])


def test_shares_are_positive_and_sum_to_one_and_lie_about_the_position_alike():
    found = shares(INSIDE)
    assert found.min() >= 0.0
    np.testing.assert_allclose(found.sum(1), 1.0)
    np.testing.assert_allclose(found @ GRID, INSIDE)
    np.testing.assert_allclose(found @ GRID**2 - INSIDE**2, 0.125**2 / 4.0)


def test_neither_shares_nor_their_slopes_jump():
    """Those of linear shares jump at each place, by as much as they are."""
    edges = (GRID[1:] + GRID[:-1]) / 2.0
    for edge in [*edges, *GRID[1:-1]]:
        before, after = shares([edge - 1e-9, edge + 1e-9])
        np.testing.assert_allclose(after, before, atol=1e-7)
        slopes = [np.imag(shared_among(edge + side * 1e-9 + 1e-30j, GRID.size)) / 1e-30 for side in (-1, 1)]
        np.testing.assert_allclose(slopes[1], slopes[0], atol=1e-5)


@pytest.mark.parametrize(("position", "expected"), [(0.0, (0.875, 0.125)), (1.0, (0.125, 0.875))])
def test_nothing_is_shared_beyond_an_end(position, expected):
    found = shares([position])[0]
    assert found.sum() == 1.0
    np.testing.assert_allclose(found[found > 0.0], expected)


def test_frequencies_follow_the_station_of_an_inertia_smoothly():
    """Summed inertias of neighbouring places made a mode 3 % too high between them, with a valley at each place."""
    stack = model.Stack(
        name="bar", length=0.465, width=0.0624, height=0.06375, n_lamina=12,
        material=model.Material(young=2e11, poisson=0.28, density=7650.0),
        contact=model.Contact(G_f=1480.0, d_f=1e-11, pressure=320e3, normal_modulus=1e9),
        mesh=model.Mesh(n_x=18, n_y=2),
    )  # fmt: skip
    effect = model.catalogue()["clamp_inertia"]
    system = model.reduce(stack.with_effects(effect), n_snapshot=1)
    total = []  # of six frequencies, which is smooth where modes cross, too
    for at in np.linspace(0.2, 0.55, 36):
        theta = {**system.theta, "clamp_roll_inertia": 0.003, "clamp_station": float(at)}
        square = la.eigh(system.matrix("K", theta), system.matrix("M", theta), eigvals_only=True)[6:12]
        total.append(np.sum(np.sqrt(square)))
    bend = np.diff(total, 2)
    assert np.abs(np.diff(bend)).max() < 0.7 * np.abs(bend).max()  # of a kink it is larger than that


BAR = model.Stack(
    name="bar", length=0.465, width=0.0624, height=0.06375, n_lamina=10,
    material=model.Material(young=2e11, poisson=0.28, density=7650.0),
    contact=model.Contact(G_f=1480.0, d_f=1e-11, pressure=320e3, normal_modulus=1e9),
    clamps=tuple(model.Clamp(mass=0.0, x=x, y=0.0, footprint=(0.04, 0.06)) for x in (-0.109, -0.03, 0.03, 0.109)),
    mesh=model.Mesh(n_x=12, n_y=2),
)  # fmt: skip


@cache
def reduced(*effects):
    """Return the bar with effects, some of them by name."""
    found = [model.catalogue()[one] if isinstance(one, str) else one for one in effects]
    return model.reduce(BAR.with_effects(*found), n_snapshot=1)


def frequencies(*effects, **parameters):
    """Return the first four elastic frequencies, up to a factor."""
    system = reduced(*effects)
    theta = {**system.theta, **parameters}
    square = la.eigh(system.matrix("K", theta), system.matrix("M", theta), eigvals_only=True)
    return np.sqrt(square[6:10])


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.62, 0.5), (-0.9, -1.0)])
def test_an_added_mass_acts_as_one_at_its_location_to_a_fifth_of_what_it_does(x, y):
    """Of one on the top lamina, in the first three modes; in the fourth, of shorter waves, a quarter is lost."""

    def terms(assembly):
        at, top = 0.5 * np.array([[x * BAR.length, y * BAR.width]]), np.zeros((BAR.n_lamina, BAR.n_lamina))
        top[-1, -1] = 1.0
        krons = tuple(square(f, assembly.plan.point_rows(f, at), sp.csr_array(top)) for f in ("u", "v", "w"))
        return (Term(name="there", target="M", factor=Monomial(exponent={"there": 1}), krons=krons),)

    there = dataclasses.replace(
        model.catalogue()["stinger_mass"],
        name="there",
        parameters=(model.Parameter(name="there", unit="kg", nominal=0.1, lower=0.0, upper=1.0, source="test"),),
        terms=terms,
    )
    bare = frequencies()
    point = frequencies(there, there=0.1) / bare - 1.0
    ours = frequencies("added_mass", added_mass=0.1, added_x=x, added_y=y) / bare - 1.0
    assert np.abs(ours - point)[:3].max() < 0.2 * np.abs(point).max()


def test_mirrored_clamps_that_are_loose_lower_the_same_modes_and_others_do_not():
    loose = [frequencies("loose_clamp", clamp_loss=0.8, clamp_number=i / 3.0) for i in range(4)]
    np.testing.assert_allclose(loose[0], loose[3], rtol=1e-3)
    np.testing.assert_allclose(loose[1], loose[2], rtol=1e-3)
    assert np.abs(loose[0] / loose[1] - 1.0).max() > 0.01


@pytest.mark.parametrize("compliance", [4e-9, 4e-8])
def test_a_loose_clamp_rides_on_its_seat_as_a_mass_on_a_spring(compliance):
    """At each mode the clamp has the apparent mass m / (1 - omega**2 m c), also above its resonance."""
    mass = 0.4
    heavy = [dataclasses.replace(clamp, mass=mass) for clamp in BAR.clamps]
    loose = model.reduce(
        dataclasses.replace(BAR, clamps=tuple(heavy)).with_effects(model.catalogue()["loose_clamp"]), n_snapshot=1
    )
    given = {"clamp_loss": 0.0, "clamp_number": 0.0, "clamp_compliance": compliance}
    observation = model.Observation(
        node=np.zeros(1, int), location=np.zeros((1, 3)), direction=np.array([[0.0, 0.0, 1.0]])
    )
    found = model.solve_modes(
        loose, G_f=1480.0, d_f=1e-11, n_mode=16, observation=observation, parameters=given
    ).elastic()
    (unit,) = [t for t in loose.assembly.terms if t.name == "loose_clamp 0 mass"]
    basis = loose.basis[:, : loose.n_displaced]
    of_clamp = basis.T @ loose.assembly.apply(unit.krons, basis)
    stiffness, inertia = (loose.matrix(t, loose.theta)[: loose.n_displaced, : loose.n_displaced] for t in "KM")
    for frequency in found.frequency[:6]:
        omega = 2.0 * np.pi * frequency
        if abs(omega**2 * mass * compliance - 1.0) < 0.1:
            continue  # the apparent mass is all but infinite
        rides = mass / (1.0 - omega**2 * mass * compliance) - mass
        square = la.eigvals(stiffness, inertia + rides * of_clamp).real
        assert np.abs(np.sqrt(np.abs(square)) / omega - 1.0).min() < 1e-4


def test_a_clamp_may_be_stated_to_ride_below_the_reference_frequency():
    """Its apparent mass is negative there; with it in the snapshots the mass had no root."""
    heavy = dataclasses.replace(BAR, clamps=tuple(dataclasses.replace(clamp, mass=1.5) for clamp in BAR.clamps))
    effect, values = model.catalogue()["loose_clamp"], {"clamp_number": 0.0, "clamp_compliance": 1e-7}  # 411 Hz
    found = []
    for stated in (values, {}):
        system = model.reduce(heavy.with_effects(effect, **stated), n_snapshot=1)
        theta = {**system.theta, **values}
        found.append(la.eigh(system.matrix("K", theta), system.matrix("M", theta), eigvals_only=True)[6:14])
    np.testing.assert_allclose(*found, rtol=1e-3)


def test_a_clamp_that_loses_more_mass_than_it_has_is_refused():
    effect = model.catalogue()["clamp_mass"]
    with pytest.raises(model.SolveError, match="the mass is not positive"):
        model.reduce(BAR.with_effects(effect, clamp_added_mass=-50.0), n_snapshot=1)
