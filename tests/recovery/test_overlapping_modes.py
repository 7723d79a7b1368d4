"""Modes whose bandwidths overlap: those that can be separated are found, and others are said to be there."""

from __future__ import annotations

import numpy as np
import pytest

from ema.identification.band_fit import modal_overlap
from ema.identification.doubtful_modes import check_modes
from ema.identification.functions import resonant
from ema.identification.identify import identify_frf
from ema.types.frf import FRF
from tests.recovery.test_identify import block, geometry

F = 0.5 * np.arange(200, 2401)
APART = np.array([130.0, 168.0, 195.0, 232.0, 275.0, 309.0, 352.0, 391.0, 447.0, 486.0, 540.0, 598.0, 641.0])
TOGETHER = np.array([905.0, 911.0, 918.0, 926.0, 931.0])
"""Five modes within a fifth of a half-power bandwidth of each other."""
N = 24


def damped(seed: int) -> FRF:
    """Return functions of modes of 3 % damping, with 0.1 % of noise."""
    rng = np.random.default_rng(seed)
    frequency = np.concatenate([APART, TOGETHER, [1300.0]])
    damping = 0.03 * np.exp(0.1 * rng.standard_normal(frequency.size))
    phi = rng.standard_normal((N, frequency.size))
    phi[0] = 0.5 + np.abs(phi[0])
    pole = 2 * np.pi * frequency * (-damping + 1j * np.sqrt(1 - damping**2))
    residue = phi * phi[0] / (2j * pole.imag)
    s = 2j * np.pi * F
    value = s**2 * (residue @ (1 / (s - pole[:, None])) + residue.conj() @ (1 / (s - pole.conj()[:, None])))
    rms = np.sqrt(np.mean(np.abs(value) ** 2, axis=1, keepdims=True))
    scatter = rng.standard_normal(value.shape) + 1j * rng.standard_normal(value.shape)
    return block(F, value + 1e-3 * rms * scatter / np.sqrt(2))


@pytest.mark.parametrize("seed", [4, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (3, 5))])
def test_modes_apart_are_found_beside_those_that_cannot_be_told(seed: int) -> None:
    model = identify_frf(damped(seed), geometry(N), name="damped")
    one = np.abs(model.frequency[:, None] - APART).argmin(axis=0)
    assert np.unique(one).size == APART.size
    assert np.all(np.abs(model.frequency[one] - APART) < 4.5 * model.frequency_std[one])
    assert model.frequency.size <= APART.size + TOGETHER.size
    assert np.all(model.error < 0.01)
    reported = [v.message for v in check_modes(damped(seed), model) if v.check == "overlap"]
    assert bool(reported) == bool(resonant(model.outside_pole, model.band).any())
    assert all("has not the phases of a mode" in message for message in reported)


def test_the_modal_overlap_factor_is_bandwidth_over_spacing() -> None:
    pole = 2 * np.pi * np.array([100.0, 110.0, 120.0]) * (-0.02 + 1j)
    assert modal_overlap(pole) == pytest.approx(0.04 * 110.0 * 3 / 20.0)
    assert modal_overlap(pole[:1]) == 0.0
