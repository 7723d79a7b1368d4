"""What is shared among places of a grid, and a mass that moves along it."""

import numpy as np
import pytest
import scipy.linalg as la

import model
from model.effects.parts import shared_among

GRID = np.linspace(0.0, 1.0, 9)
INSIDE = np.linspace(0.0625, 0.9375, 300)


def shares(positions):
    return np.array([shared_among(float(x), GRID) for x in positions])


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
        slopes = [np.imag(shared_among(edge + side * 1e-9 + 1e-30j, GRID)) / 1e-30 for side in (-1, 1)]
        np.testing.assert_allclose(slopes[1], slopes[0], atol=1e-5)


@pytest.mark.parametrize(("position", "expected"), [(0.0, (0.875, 0.125)), (1.0, (0.125, 0.875))])
def test_nothing_is_shared_beyond_an_end(position, expected):
    found = shares([position])[0]
    assert found.sum() == 1.0
    np.testing.assert_allclose(found[found > 0.0], expected)


def test_frequencies_follow_the_station_of_an_inertia_smoothly():
    """Summed inertias of neighbouring places made a mode 3 % too high between them, with a valley at each place."""
    stack = model.Stack(
        name="bar", length=0.465, width=0.0624, height=0.06375, n_lamina=40,
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
