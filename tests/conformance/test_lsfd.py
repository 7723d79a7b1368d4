"""Residues against sdypy-EMA's and against the functions they were drawn from."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from ema.frf import Quantity
from ema.lsfd import lsfd_residues

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
    residue, lower, upper = lsfd_residues(f, value, POLE, quantity)
    np.testing.assert_allclose(residue, RESIDUE, rtol=1e-8)
    np.testing.assert_allclose(lower, LOWER, rtol=1e-6)
    np.testing.assert_allclose(upper, UPPER, rtol=1e-6)


def test_line_at_zero_is_left_out() -> None:
    f = np.arange(0.0, 400.0)
    value = np.full((3, 2, f.size), np.nan + 0j)
    value[..., 1:] = receptance(f[1:])
    residue, _, _ = lsfd_residues(f, value, POLE, "receptance")
    np.testing.assert_allclose(residue, RESIDUE, rtol=1e-8)


def test_residues_are_those_of_sdypy() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from sdypy.EMA.EMA import LSFD
    f = np.arange(1.0, 400.0)
    value = receptance(f)[:, 0] * (2j * np.pi * f) ** 2
    peer = LSFD(POLE, value.copy(), f.copy(), True, True, 0, f.size, "accelerance")[0]
    ours, _, _ = lsfd_residues(f, value, POLE, "accelerance")
    np.testing.assert_allclose(ours, peer, rtol=1e-6)
