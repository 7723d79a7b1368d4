"""FRFs side by side."""

import numpy as np
import pytest

from updating.correlation.correlation import correlate_frf, fdac
from updating.errors import UpdatingError

LINES = np.linspace(10.0, 100.0, 181)


def functions(stretch=1.0):
    """Two modes of 12 outputs and 2 inputs; `stretch` moves the resonances."""
    phi = np.random.default_rng(3).standard_normal((12, 2))
    omega = 2.0 * np.pi * LINES
    pole = 2.0 * np.pi * stretch * np.array([30.0, 70.0])[:, None]
    modal = 1.0 / (pole**2 - omega**2 + 0.04j * pole * omega)
    return np.einsum("ir,jr,rk->ijk", phi, phi[:2], modal)


def test_a_function_agrees_with_itself():
    found = correlate_frf(functions(), functions(), LINES)
    np.testing.assert_allclose(found.frac, 1.0)
    np.testing.assert_allclose(found.csac, 1.0)
    np.testing.assert_allclose(found.csf, 1.0)


def test_a_factor_shows_in_the_scale_factor_alone():
    found = correlate_frf(functions(), 3.0 * functions(), LINES)
    np.testing.assert_allclose(found.csac, 1.0)
    np.testing.assert_allclose(found.csf, 2 * 3 / (1 + 9))
    np.testing.assert_allclose(found.frac, 1.0)


def test_moved_resonances_show_between_them():
    found = correlate_frf(functions(), functions(1.1), LINES)
    assert found.csac[np.argmin(abs(LINES - 31.5))] > 0.9  # both sides move in the first mode
    assert found.csf[np.argmin(abs(LINES - 30.0))] < 0.6  # but not as much
    assert found.frac.max() < 0.6


def test_fdac_has_its_ridge_at_the_moved_frequencies():
    """All poles a tenth higher: the line of the model that looks like a measured resonance is a tenth higher too."""
    ridge = fdac(functions(), functions(1.1))
    for resonance in (30.0, 70.0):
        like = LINES[np.argmax(ridge[np.argmin(abs(LINES - resonance))])]
        np.testing.assert_allclose(like, 1.1 * resonance, atol=0.6)


def test_fdac_tells_opposite_phase():
    np.testing.assert_allclose(np.diag(fdac(functions(), -functions())), -1.0)


def test_different_functions_are_refused():
    with pytest.raises(UpdatingError, match=r"got \(12, 2, 181\) and \(11, 2, 181\)"):
        correlate_frf(functions(), functions()[:11], LINES)
    with pytest.raises(UpdatingError, match="same outputs and inputs"):
        fdac(functions(), functions()[:, :1])
    with pytest.raises(UpdatingError, match="181 lines were given with 180 frequencies"):
        correlate_frf(functions(), functions(), LINES[1:])
