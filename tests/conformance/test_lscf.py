"""Our LSCF against sdypy-EMA's, and its own properties."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from numpy.typing import NDArray

from ema.identification.stabilization import lscf_poles
from ema.types.errors import IdentificationError

FREQUENCY = np.array([152.0, 398.0, 611.0, 800.0, 1100.0, 1390.0])
DAMPING = np.array([0.002, 0.005, 0.01, 0.02, 0.004, 0.04])
POLE = 2 * np.pi * FREQUENCY * (-DAMPING + 1j * np.sqrt(1 - DAMPING**2))


def functions(f: NDArray, noise: float, n_output: int = 12, n_input: int = 1) -> NDArray:
    rng = np.random.default_rng(0)
    out, inp = rng.standard_normal((n_output, 6)), rng.standard_normal((n_input, 6))
    s = 2j * np.pi * f
    kernel = s**2 / (s - POLE[:, None]) / (2j * POLE.imag[:, None])
    mirror = s**2 / (s - POLE.conj()[:, None]) / (-2j * POLE.imag[:, None])
    value = np.einsum("or,ir,rf->oif", out, inp, kernel + mirror)
    rms = np.sqrt(np.mean(np.abs(value) ** 2, axis=-1, keepdims=True))
    scatter = rng.standard_normal(value.shape) + 1j * rng.standard_normal(value.shape)
    return value + noise * rms * scatter / np.sqrt(2)


def nearest(found: NDArray, wanted: NDArray) -> NDArray:
    return found[np.argmin(np.abs(found[:, None] - wanted), axis=0)]


# Without noise the normal equations are singular to rounding, which either code amplifies in its own way.
@pytest.mark.parametrize(("noise", "relative"), [(0.0, 1e-7), (0.01, 1e-8)])
def test_physical_poles_are_those_of_sdypy(noise: float, relative: float) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from sdypy.EMA import Model
    f = np.arange(0.0, 2000.5, 1.0)
    value = functions(f, noise)
    # sdypy drops the line at its upper end and takes 0 Hz as no lower limit, so both get lines 1 to 1999 Hz.
    model = Model(value[:, 0].copy(), f.copy(), lower=1.0, upper=2000.0, pol_order_high=40)
    model.get_poles(show_progress=False)
    ours = lscf_poles(f[1:-1], value[..., 1:-1], 40)
    for order in (12, 20, 40):
        peer, one = nearest(np.asarray(model.all_poles[order - 1]), POLE), nearest(ours[order - 1], POLE)
        np.testing.assert_allclose(one, peer, rtol=relative)


def test_narrow_band_keeps_its_poles() -> None:
    f = np.arange(700.0, 1200.0, 0.5)
    found = lscf_poles(f, functions(f, 0.001), 40)[-1]
    np.testing.assert_allclose(nearest(found, POLE[3:5]), POLE[3:5], rtol=1e-4)


def test_several_references_share_the_poles() -> None:
    f = np.arange(0.5, 2000.0, 1.0)
    poles = lscf_poles(f, functions(f, 0.001, n_output=8, n_input=2), 30)
    # More than the 30 of one reference; up to a few of the 60 are real and so not in the upper half-plane.
    assert 50 <= poles[-1].size <= 60
    np.testing.assert_allclose(nearest(poles[-1], POLE), POLE, rtol=1e-3)


def test_two_references_separate_a_repeated_pole() -> None:
    f = np.arange(0.5, 1000.0, 0.5)
    s = 2j * np.pi * f
    pole = 2 * np.pi * 300.0 * (-0.01 + 1j)
    line = (s**2 / ((s - pole) * (s - np.conj(pole))))[None]
    vectors = np.random.default_rng(1).standard_normal((2, 5, 2))
    value = np.einsum("or,ir,rf->oif", vectors[0], vectors[1, :2], np.repeat(line, 2, axis=0))
    rms = np.sqrt(np.mean(np.abs(value) ** 2))
    value += 1e-4 * rms * np.random.default_rng(2).standard_normal(value.shape)
    found = lscf_poles(f, value, 10)[-1]
    assert np.count_nonzero(np.abs(found - pole) < 1e-2 * np.abs(pole)) == 2


def test_what_cannot_be_fitted_is_refused() -> None:
    f = np.arange(1.0, 30.0)
    with pytest.raises(IdentificationError, match=r"order 40 needs more lines than the 29"):
        lscf_poles(f, np.ones((1, 1, 29), dtype=complex), 40)
    value = np.ones((1, 1, 29), dtype=complex)
    value[0, 0, 3] = np.nan
    with pytest.raises(IdentificationError, match="NaN"):
        lscf_poles(f, value, 4)
