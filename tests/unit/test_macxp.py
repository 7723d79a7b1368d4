"""MAC of complex modes with and without poles."""

import numpy as np
import pytest

from updating.correlation.pairing import macxp, poles


@pytest.fixture
def shape():
    return np.random.default_rng(1).standard_normal((10, 3))


def decay(shape, pole, time):
    return np.real(shape[:, None] * np.exp(pole * time))


def test_poles_hold_frequency_and_damping():
    pole = poles([100.0], [0.02])
    np.testing.assert_allclose(np.abs(pole) / (2 * np.pi), 100.0)
    np.testing.assert_allclose(-pole.real / np.abs(pole), 0.02)


def test_equal_modes_have_one(shape):
    phi = shape + 0.4j * shape[:, ::-1]
    pole = poles([10.0, 20.0, 30.0], [0.1, 0.02, 0.05])
    np.testing.assert_allclose(np.diag(macxp(phi, pole, phi, pole)), 1.0)


def test_real_shapes_keep_the_norm_of_their_decays(shape):
    """The norm that the criterion divides by is the integral of the squared decay with its best phase."""
    pole = poles([1.0], [0.05])[0]
    time = np.linspace(0.0, 40.0, 40_001)
    step = time[1] - time[0]
    largest = max(
        np.sum(decay(shape[:, 0] * np.exp(1j * angle), pole, time) ** 2) * step
        for angle in np.linspace(0.0, np.pi, 181)
    )
    square = shape[:, 0] @ shape[:, 0]
    norm = square / (2 * abs(pole.real)) + square / (2 * abs(pole))
    np.testing.assert_allclose(largest, norm / 2, rtol=1e-3)


def test_light_damping_gives_the_lorentzian_of_the_docstring(shape):
    pole_1, pole_2 = poles([100.0], [0.01]), poles([102.0], [0.03])
    d_1, d_2 = -pole_1.real, -pole_2.real
    expected = 4 * d_1 * d_2 / ((d_1 + d_2) ** 2 + (np.abs(pole_1) - np.abs(pole_2)) ** 2)
    found = macxp(shape[:, :1], pole_1, shape[:, :1], pole_2)[0]
    np.testing.assert_allclose(found, expected, rtol=0.05)


def test_a_growing_mode_is_refused(shape):
    with pytest.raises(ValueError, match="pole_b: MACXP needs decaying modes, but pole 1"):
        macxp(shape[:, :2], [-1 + 5j, -1 + 9j], shape[:, :2], [-1 + 5j, 1 + 9j])
