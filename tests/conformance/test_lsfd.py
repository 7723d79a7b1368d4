"""Residues against sdypy-EMA's and against the functions they were drawn from."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from ema.identification.maximum_likelihood import linear_fit
from ema.types.frf import Quantity

POLE = 2 * np.pi * np.array([100.0, 240.0]) * (-0.01 + 1j)
RNG = np.random.default_rng(0)
RESIDUE = RNG.standard_normal((3, 2, 2)) + 1j * RNG.standard_normal((3, 2, 2))
LOWER, UPPER = RNG.standard_normal((2, 3, 2)) * np.array([50.0, 1e-3])[:, None, None]


def receptance(f: np.ndarray) -> np.ndarray:
    s = 2j * np.pi * f
    modes = RESIDUE @ (1 / (s - POLE[:, None])) + RESIDUE.conj() @ (1 / (s - POLE.conj()[:, None]))
    return modes + LOWER[..., None] / s**2 + UPPER[..., None]


@pytest.mark.parametrize(("quantity", "power"), [("receptance", 0), ("mobility", 1), ("accelerance", 2)])
def test_residues_and_residual_terms_are_recovered_in_any_quantity(quantity: Quantity, power: int) -> None:
    f = np.arange(1.0, 400.0)
    value = receptance(f) * (2j * np.pi * f) ** power
    fit = linear_fit(f, value.reshape(6, -1), POLE, quantity)
    np.testing.assert_allclose(fit.residue, RESIDUE.reshape(6, 2), rtol=1e-8)
    np.testing.assert_allclose(fit.lower, LOWER.ravel(), rtol=1e-6)
    np.testing.assert_allclose(fit.upper, UPPER.ravel(), rtol=1e-6)


def test_residues_are_those_of_sdypy() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from sdypy.EMA.EMA import LSFD
    f = np.arange(1.0, 400.0)
    value = receptance(f)[:, 0] * (2j * np.pi * f) ** 2
    peer = LSFD(POLE, value.copy(), f.copy(), True, True, 0, f.size, "accelerance")[0]
    ours = linear_fit(f, value, POLE, "accelerance").residue
    np.testing.assert_allclose(ours, peer, rtol=1e-6)
