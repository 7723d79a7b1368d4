"""Measured shapes over the whole model, and their orthogonality in its mass."""

import dataclasses

import numpy as np
import pytest

import model
from updating.correlation.pairing import cross_orthogonality
from updating.correlation.registration import expand, pseudo_orthogonality
from updating.errors import PairingError


@pytest.fixture(scope="module")
def system():
    stack = model.Stack(
        name="test",
        length=0.465,
        width=0.0624,
        height=0.064,
        n_lamina=40,
        material=model.Material(young=200e9, poisson=0.28, density=7650.0),
        contact=model.Contact(G_f=4200.0, d_f=1.5e-11, pressure=320e3, normal_modulus=1e9),
        clamps=tuple(model.Clamp(mass=2.84, x=x, y=0.0, footprint=(0.04, 0.05)) for x in (-0.1, 0.1)),
        mesh=model.Mesh(n_x=10, n_y=2),
    )
    return model.reduce(stack, G_f_range=(3500.0, 5000.0))


def solve(system, G_f, observation, n_mode=20):
    return model.solve_modes(system, G_f=G_f, d_f=1e-11, n_mode=n_mode, observation=observation).elastic()


def edges(stack):
    """Four edges, eleven stations."""
    half = np.array([stack.length, stack.width, stack.height]) / 2.0
    grid = np.meshgrid(np.linspace(-1.0, 1.0, 11), [-1.0, 1.0], [-1.0, 1.0], indexing="ij")
    return model.Observation(
        node=np.arange(44),
        location=half * np.stack(grid, axis=-1).reshape(-1, 3),
        direction=np.tile([0.0, 0.0, 1.0], (44, 1)),
    )


@pytest.fixture(scope="module")
def expanded(system):
    """Six modes of a stack that is a little softer, expanded in the model's own."""
    grid = edges(system.stack)
    test, modes = solve(system, 4000.0, grid), solve(system, 4400.0, grid, 18)
    noise = 0.01 * np.sqrt(np.mean(test.shape[:, :6] ** 2, axis=0)) * np.ones((44, 1))
    shape = test.shape[:, :6] + noise * np.random.default_rng(0).standard_normal((44, 6))
    return test, modes, expand(shape, noise, modes)


def seen(modes):
    """The modes that move the points along z."""
    return np.linalg.norm(modes.shape, axis=0) > 1e-3


def test_expansion_meets_the_whole_mode(expanded, system):
    test, _, found = expanded
    mass = system.matrix("M", system.theta)
    at_points = seen(test)[:6]
    one = np.diag(cross_orthogonality(found.coordinate, test.coordinate[:, :6], mass))
    assert one[at_points].min() > 0.995
    assert found.matched[at_points].min() > 0.999
    assert found.condition < 20.0


def test_orthogonality_of_measured_modes_meets_the_standard(expanded, system):
    test, _, found = expanded
    at_points = seen(test)[:6]
    mass = system.matrix("M", system.theta)
    check = cross_orthogonality(found.coordinate, found.coordinate, mass)[np.ix_(at_points, at_points)]
    np.testing.assert_allclose(np.diag(check), 1.0)
    assert np.abs(check - np.eye(len(check))).max() < 0.1


def test_amplitudes_scatter_as_foretold(system):
    grid = edges(system.stack)
    modes = solve(system, 4400.0, grid, 16)
    std = 0.02 * np.ones((44, 1))
    rng = np.random.default_rng(0)
    drawn = np.array(
        [
            expand(modes.shape[:, :1] + std * rng.standard_normal((44, 1)), std, modes).amplitude[:, 0]
            for _ in range(300)
        ]
    )
    foretold = expand(modes.shape[:, :1], std, modes).amplitude_std[:, 0]
    np.testing.assert_allclose(drawn.real.std(axis=0), foretold, rtol=0.2)


def test_cross_orthogonality_tells_modes_apart_that_the_mac_confuses(system):
    grid = edges(system.stack)
    modes = solve(system, 4400.0, grid, 14)
    cross, condition = pseudo_orthogonality(modes.shape, modes.shape)
    at_points = seen(modes)
    np.testing.assert_allclose(cross[np.ix_(at_points, at_points)], np.eye(at_points.sum()), atol=1e-6)
    assert 1.0 < condition < 20.0


def test_points_that_cannot_tell_modes_apart_are_refused(system):
    grid = edges(system.stack)
    few = dataclasses.replace(grid, node=grid.node[:4], location=grid.location[:4], direction=grid.direction[:4])
    modes = solve(system, 4400.0, few, 16)
    with pytest.raises(PairingError, match="4 measured DOFs cannot tell 10 modes"):
        expand(modes.shape[:, :1], np.zeros((4, 1)), modes)
