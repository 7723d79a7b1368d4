"""Roving masses taken out of the modes of a chain whose equations are solved with and without them."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la

from ema.modal.mass_cancellation import RovedModes, loaded, without_sensors

N = 6
STIFFNESS = 1e6 * (2.0 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1))
MASS = np.diag(np.linspace(1.0, 2.0, N))
FORCE = 1
STD = 1e-6


def chain(*points, mass=0.0):
    """Frequencies, Hz, and mass-normalised shapes with a mass on each of some points; positive at the force."""
    total = MASS.copy()
    for point in points:
        total[point, point] += mass
    square, shape = la.eigh(STIFFNESS, total)
    return np.sqrt(square) / (2.0 * np.pi), shape * np.sign(shape[FORCE])


def roved(mass, *, scale=True, places=tuple((point,) for point in range(N)), band=slice(N)):
    """What a test with sensors, roving over all points, has for its modes; the driving point is among them.

    `places` are the points of the sensors in each run: by default of one sensor.
    """
    runs = [chain(*points, mass=mass) for points in places]
    run = np.array([next(k for k, points in enumerate(places) if point in points) for point in range(N)])
    drive = runs[run[FORCE]][1][FORCE] if scale else np.ones(N)
    shape = np.array([runs[k][1][point] * runs[k][1][FORCE] for point, k in enumerate(run)]) / drive
    frequency = np.array([f for f, _ in runs])[:, band]
    inside = np.isin(np.arange(N), np.arange(N)[band])
    rest = np.zeros((N, frequency.shape[1]))
    for point, k in enumerate(run):
        one, modes = (2.0 * np.pi * runs[k][0]) ** 2, runs[k][1]
        beyond = (modes[point] * modes[FORCE])[~inside]
        rest[point] = np.sum(beyond / (one[~inside] - one[band, None]), axis=1)
    return RovedModes(
        frequency=frequency,
        std=STD * frequency,
        shape=shape[:, band],
        run=run,
        drive=drive[band],
        drive_run=int(run[FORCE]) if scale else None,
        rest=rest if scale else None,
    )


def test_a_mass_moves_the_modes_as_the_equations_with_it_say():
    frequency, shape = chain()
    square, turn = loaded((2 * np.pi * frequency) ** 2, np.sqrt(0.1) * shape[[3]])
    expected, moved = chain(3, mass=0.1)
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


def test_shapes_of_any_unit_do_where_their_modal_constants_are_known():
    constants, bare = roved(0.05, scale=False), chain()
    unit = np.geomspace(0.1, 10.0, N)
    measured = replace(constants, shape=constants.shape * unit, drive=1.0 / unit)
    found = without_sensors(measured, np.full(N, np.nan))
    np.testing.assert_allclose(found.frequency, bare[0], rtol=1e-6)
    np.testing.assert_allclose(found.shape, bare[1] * bare[1][FORCE] * unit, atol=1e-4 * np.abs(found.shape).max())


def test_shapes_are_not_moved_for_shifts_that_no_mass_makes():
    # 5 % were allowed to each shape whatever the shifts, so that scatter bent them all
    measured = roved(0.005, scale=False)
    shift = measured.frequency / measured.frequency.mean(axis=0) - 1.0
    scatter = 0.03 * np.abs(shift).max() * np.random.default_rng(0).standard_normal(shift.shape)
    odd = replace(measured, frequency=measured.frequency * (1.0 + scatter))
    found, sound = (without_sensors(one, np.full(N, np.nan)) for one in (odd, measured))
    moved = np.abs(found.shape - sound.shape) / np.sqrt(np.mean(sound.shape**2, axis=0))
    assert moved.max() < 0.05
    assert np.std(found.off_as_measured) > 0.5 * np.std(scatter)


def test_runs_that_do_not_determine_a_mode_do_not_count():
    measured = roved(0.05)
    std, frequency = measured.std.copy(), measured.frequency.copy()
    std[2, 1], frequency[2, 1] = np.inf, 1.2 * frequency[2, 1]
    holed = RovedModes(**{**vars(measured), "std": std, "frequency": frequency})
    np.testing.assert_allclose(without_sensors(holed, np.full(N, 0.05)).frequency, chain()[0], rtol=1e-9)


@pytest.mark.parametrize("mass", [0.005, 0.01, 0.03])
@pytest.mark.parametrize("band", [slice(0, 3), slice(1, 5), slice(2, 6), slice(0, 5)])
@pytest.mark.parametrize("places", [((0, 1, 2), (3, 4, 5)), ((0, 2, 4), (1, 3, 5)), ((0, 3), (1, 4), (2, 5))])
def test_intervals_hold_what_the_modes_beyond_the_band_are_worth(mass, band, places):
    # few runs of several sensors do not scatter as much as all of them are off
    measured = roved(mass, places=places, band=band)
    bare = without_sensors(measured, np.full(measured.drive.size, mass))
    assert np.all(np.abs(bare.frequency - chain()[0][band]) < 2.0 * bare.frequency_std)
    shift = np.abs(measured.frequency.mean(axis=0) - bare.frequency)
    assert np.all(bare.frequency_std < 0.5 * shift)
