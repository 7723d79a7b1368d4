"""Roving masses taken out of the modes of a chain whose equations are solved with and without them."""

import numpy as np
import pytest
import scipy.linalg as la

from ema.modal.mass_cancellation import RovedModes, loaded, without_sensors

N = 6
STIFFNESS = 1e6 * (2.0 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1))
MASS = np.diag(np.linspace(1.0, 2.0, N))
FORCE = 1
STD = 1e-6


def chain(point=None, mass=0.0):
    """Frequencies, Hz, and mass-normalised shapes with a mass on one point; positive at the force."""
    total = MASS.copy()
    if point is not None:
        total[point, point] += mass
    square, shape = la.eigh(STIFFNESS, total)
    return np.sqrt(square) / (2.0 * np.pi), shape * np.sign(shape[FORCE])


def roved(mass, *, scale=True):
    """What a test with one sensor, roving over all points, has for its modes; the driving point is among them."""
    runs = [chain(point, mass) for point in range(N)]
    drive = runs[FORCE][1][FORCE] if scale else np.ones(N)
    shape = np.array([own[k] * own[FORCE] for k, (_, own) in enumerate(runs)]) / drive
    frequency = np.array([f for f, _ in runs])
    return RovedModes(
        frequency=frequency,
        std=STD * frequency,
        shape=shape,
        run=np.arange(N),
        drive=drive,
        drive_run=FORCE if scale else None,
    )


def test_a_mass_moves_the_modes_as_the_equations_with_it_say():
    frequency, shape = chain()
    square, turn = loaded((2 * np.pi * frequency) ** 2, np.sqrt(0.1) * shape[[3]])
    expected, moved = chain(3, 0.1)
    np.testing.assert_allclose(np.sqrt(square) / (2 * np.pi), expected, rtol=1e-10)
    np.testing.assert_allclose(np.abs(shape @ turn), np.abs(moved), atol=1e-9)


@pytest.mark.parametrize("mass", [0.005, 0.03, 0.1])
def test_a_known_mass_is_taken_out_of_frequencies_and_shapes(mass):
    frequency, shape = chain()
    measured = roved(mass)
    assert np.abs(measured.frequency / frequency - 1).max() > 0.1 * mass / 2.0
    bare = without_sensors(measured, np.full(N, mass))
    np.testing.assert_allclose(bare.frequency, frequency, rtol=1e-9)
    np.testing.assert_allclose(bare.shape, shape, atol=1e-8)
    np.testing.assert_array_equal(bare.load, mass)


def test_a_mass_that_nobody_stated_is_told_by_the_runs():
    bare = without_sensors(roved(0.05), None)
    np.testing.assert_allclose(bare.load, 0.05, rtol=1e-6)
    np.testing.assert_allclose(bare.frequency, chain()[0], rtol=1e-8)
    assert np.all(bare.load_std > 0.0)


def test_shapes_without_a_scale_do_for_the_frequencies():
    bare = without_sensors(roved(0.05, scale=False), np.full(N, np.nan))
    np.testing.assert_allclose(bare.frequency, chain()[0], rtol=1e-6)
    # the load is the mass over the square of the shape at the force: what scales the modes
    np.testing.assert_allclose(bare.load, 0.05 / chain()[1][FORCE] ** 2, rtol=1e-4)


def test_runs_that_do_not_determine_a_mode_do_not_count():
    measured = roved(0.05)
    std, frequency = measured.std.copy(), measured.frequency.copy()
    std[2, 1], frequency[2, 1] = np.inf, 1.2 * frequency[2, 1]
    holed = RovedModes(**{**vars(measured), "std": std, "frequency": frequency})
    np.testing.assert_allclose(without_sensors(holed, np.full(N, 0.05)).frequency, chain()[0], rtol=1e-9)
