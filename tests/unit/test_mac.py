"""Shape measures against hand-made vectors."""

from __future__ import annotations

import numpy as np
import pytest

from ema.modal.mac import cmif, comac, frac, mac, mcf, modal_scale_factor, mpc, mpd, real_shape

RNG = np.random.default_rng(0)


def complex_shapes(n: int, m: int) -> np.ndarray:
    return RNG.standard_normal((n, m)) + 1j * RNG.standard_normal((n, m))


def test_mac_ignores_scale_and_phase_and_is_zero_for_orthogonal_shapes() -> None:
    phi = complex_shapes(8, 3)
    np.testing.assert_allclose(np.diag(mac(phi, phi * [2.0, -1j, 3 + 4j])), 1.0)
    np.testing.assert_allclose(mac(np.eye(3), np.eye(3)), np.eye(3))
    # cos(60 degrees) squared
    assert mac([[1.0], [0.0]], [[0.5], [np.sqrt(3) / 2]])[0, 0] == pytest.approx(0.25)


def test_mac_uses_the_conjugate() -> None:
    a = np.array([[1.0], [1j]])
    assert mac(a, a.conj())[0, 0] == pytest.approx(0.0, abs=1e-15)


def test_mac_refuses_what_it_cannot_compare() -> None:
    with pytest.raises(ValueError, match="same DOFs: got 3 and 4"):
        mac(np.ones((3, 1)), np.ones((4, 1)))
    with pytest.raises(ValueError, match="b: shape 1 is zero"):
        mac(np.ones((2, 2)), [[1.0, 0.0], [1.0, 0.0]])
    with pytest.raises(ValueError, match="columns"):
        mac(np.ones(3), np.ones(3))


def test_scale_factor_brings_a_shape_to_its_partner() -> None:
    phi = complex_shapes(6, 2)
    np.testing.assert_allclose(modal_scale_factor(phi, phi * [2j, -0.5]), [2j, -0.5])


def test_comac_finds_the_point_that_disagrees() -> None:
    a = RNG.standard_normal((6, 4))
    b = 3.0 * a
    np.testing.assert_allclose(comac(a, b), 1.0)
    b[2] = RNG.standard_normal(4)
    assert int(np.argmin(comac(a, b))) == 2


def test_phase_measures_of_real_turned_and_circular_shapes() -> None:
    real = np.array([[1.0], [-2.0], [0.5]])
    turned = real * np.exp(0.7j)
    circular = np.exp(2j * np.pi * np.arange(3) / 3)[:, None]
    np.testing.assert_allclose(mpc(np.hstack([real, turned, circular])), [1.0, 1.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(mcf(turned), 0.0, atol=1e-15)
    np.testing.assert_allclose(mpd(np.hstack([real + 0j, turned])), 0.0, atol=1e-7)
    # Two components of equal size 2 d apart in phase lie d off their best line.
    np.testing.assert_allclose(mpd(np.array([[np.exp(0.1j)], [np.exp(-0.1j)]])), 0.1)


def test_real_shape_recovers_a_turned_real_mode_and_keeps_the_norm() -> None:
    real = np.array([[0.3], [-1.0], [0.8]])
    # The largest component becomes positive along the line of the shape.
    np.testing.assert_allclose(real_shape(real * np.exp(2.0j)), -real * np.sign(-1.0) * -1.0, atol=1e-12)
    noisy = complex_shapes(5, 2)
    np.testing.assert_allclose(np.linalg.norm(real_shape(noisy), axis=0), np.linalg.norm(noisy, axis=0))


def test_cmif_of_one_input_is_the_norm_over_the_outputs() -> None:
    value = complex_shapes(7, 11)[:, None, :]
    np.testing.assert_allclose(cmif(value), np.linalg.norm(value, axis=0))


def test_frac_is_one_for_scaled_functions_and_less_for_others() -> None:
    a = complex_shapes(3, 50)
    np.testing.assert_allclose(frac(a, a * 2j), 1.0)
    assert np.all(frac(a, a + complex_shapes(3, 50)) < 0.9)
    np.testing.assert_array_equal(frac(a, np.zeros_like(a)), 0.0)
