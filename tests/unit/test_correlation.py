"""Paired modes side by side, with what noise allows."""

from types import SimpleNamespace

import numpy as np
import pytest

from updating.correlation.correlation import correlate, correlate_points
from updating.correlation.pairing import pair
from updating.errors import PairingError

N_DOF = 30


def modes(shape, frequency, damping, std=0.0):
    return SimpleNamespace(
        frequency=np.asarray(frequency, dtype=float),
        damping=np.asarray(damping, dtype=float),
        shape=shape,
        node=np.arange(N_DOF),
        direction=np.tile([0.0, 0.0, 1.0], (N_DOF, 1)),
        frequency_std=np.full(len(frequency), 0.02),
        damping_std=np.full(len(frequency), 1e-4),
        shape_std=np.full(shape.shape, std),
    )


@pytest.fixture
def shape():
    return np.random.default_rng(7).standard_normal((N_DOF, 4))


@pytest.fixture
def correlated(shape):
    def of(measured_shape, std=0.01):
        measured = modes(measured_shape, [100, 200, 300, 400], [0.01, 0.02, 0.01, 0.02], std)
        model = modes(shape, [110, 190, 330, 360], [0.012, 0.01, 0.01, 0.02])
        return correlate(measured, model, pair(measured, model)), correlate_points(
            measured, model, pair(measured, model, threshold=0.7)
        )

    return of


def test_errors_are_relative_to_the_measurement(correlated, shape):
    found, _ = correlated(shape)
    np.testing.assert_allclose(found.frequency_error, [0.1, -0.05, 0.1, -0.1])
    np.testing.assert_allclose(found.damping_error, [0.2, -0.5, 0.0, 0.0], atol=1e-12)


def test_standard_deviations_are_those_of_the_ratio(correlated, shape):
    found, _ = correlated(shape)
    rng = np.random.default_rng(0)
    drawn = 110.0 / rng.normal(100.0, 0.02, 20_000) - 1.0
    np.testing.assert_allclose(found.frequency_error_std[0], drawn.std(), rtol=0.03)
    drawn = 0.01 / rng.normal(0.02, 1e-4, 20_000) - 1.0
    np.testing.assert_allclose(found.damping_error_std[1], drawn.std(), rtol=0.03)


def test_noise_alone_leaves_the_mac_that_is_foretold(correlated, shape):
    rng = np.random.default_rng(0)
    found = [correlated(shape + 0.1 * rng.standard_normal(shape.shape), std=0.1)[0] for _ in range(200)]
    mean = np.mean([f.mac for f in found], axis=0)
    np.testing.assert_allclose(1.0 - mean, 1.0 - found[0].noise_mac, rtol=0.15)


def test_equal_shapes_agree_at_every_point(correlated, shape):
    _, points = correlated(shape * np.array([2.0, -1.0, 0.5j, 3.0]))
    np.testing.assert_allclose(points.comac, 1.0)
    np.testing.assert_allclose(points.s_comac, 1.0)
    np.testing.assert_allclose(points.e_comac, 0.0, atol=1e-12)
    np.testing.assert_allclose(points.error, 0.0, atol=1e-12)
    np.testing.assert_allclose(points.scale, [2.0, -1.0, 0.5j, 3.0])


def test_a_flipped_sensor_shows_in_ecomac_and_error_but_not_in_comac(correlated, shape):
    wrong = shape.copy()
    wrong[11] *= -1.0
    _, points = correlated(wrong)
    assert np.argmax(points.e_comac) == np.argmax(points.error) == 11
    assert points.comac[11] > 0.99


def test_a_sensor_that_is_wrong_in_one_mode_shows_in_scomac(correlated, shape):
    wrong = shape.copy()
    sensor = np.argmax(np.min(np.abs(shape), axis=1))  # one that moves in every mode
    wrong[sensor, 2] *= -1.0
    _, points = correlated(wrong)
    assert np.argmin(points.s_comac) == sensor
    assert points.comac[sensor] > 0.99


def test_errors_from_noise_have_the_size_that_is_foretold(correlated, shape):
    rng = np.random.default_rng(1)
    found = [correlated(shape + 0.05 * rng.standard_normal(shape.shape), std=0.05)[1] for _ in range(50)]
    square = np.mean([f.error**2 for f in found])
    np.testing.assert_allclose(square, np.mean(found[0].error_std ** 2), rtol=0.1)


def test_mixed_close_modes_are_compared_after_turning(shape):
    basis = np.linalg.qr(shape)[0]
    c = np.sqrt(0.5)
    mixed = basis.copy()
    mixed[:, 1:3] = basis[:, 1:3] @ np.array([[c, -c], [c, c]])
    frequency, damping = [100, 200, 201, 400], [0.01] * 4
    measured, model = modes(basis, frequency, damping), modes(mixed, frequency, damping)
    points = correlate_points(measured, model, pair(measured, model))
    np.testing.assert_allclose(points.error, 0.0, atol=1e-10)


def test_no_pairs_no_points(shape):
    other = np.random.default_rng(8).standard_normal(shape.shape)
    measured, model = (modes(s, [1, 2, 3, 4], [0.01] * 4) for s in (shape, other))
    with pytest.raises(PairingError, match=r"no modes are paired at a MAC of 0\.8"):
        correlate_points(measured, model, pair(measured, model))
