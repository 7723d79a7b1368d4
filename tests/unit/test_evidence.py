"""What counts as a mode: noise, misfits, splits and images in single runs do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.identification.evidence import is_confined, is_split, judge, likeliest_poles, variance_inflation
from ema.identification.maximum_likelihood import linear_fit, refine

F = np.arange(1.0, 800.0, 0.5)
POLE = 2 * np.pi * np.array([100.0, 240.0, 500.0]) * (-0.01 + 1j)
PHI = np.random.default_rng(0).standard_normal((10, 3))


def functions(constant: NDArray, noise: float, seed: int = 1) -> NDArray:
    """Receptances of modal constants ``2 i omega A``, noise of a share of the overall rms."""
    residue = constant / (2j * POLE.imag)
    s = 2j * np.pi * F
    value = residue @ (1 / (s - POLE[:, None])) + residue.conj() @ (1 / (s - POLE.conj()[:, None]))
    rng = np.random.default_rng(seed)
    scatter = rng.standard_normal(value.shape) + 1j * rng.standard_normal(value.shape)
    return value + noise * np.sqrt(np.mean(np.abs(value) ** 2)) * scatter / np.sqrt(2)


def test_a_pole_without_a_mode_is_insignificant() -> None:
    value = functions(PHI * [1.0, 0.0, 1.0], 0.01)
    verdicts = judge(F, linear_fit(F, value, POLE, "receptance"), "receptance")
    np.testing.assert_array_equal(verdicts.accepted, [True, False, True])


def test_a_weak_pole_with_scattered_phases_is_no_mode_and_a_dominant_one_is() -> None:
    phase = np.exp(0.6j * (-1.0) ** np.arange(10))[:, None]
    constant = np.hstack([PHI[:, :1] + 0j, 0.002 * phase * PHI[:, 1:2], PHI[:, 2:] * phase])
    verdicts = judge(F, linear_fit(F, functions(constant, 1e-5), POLE, "receptance"), "receptance")
    assert np.all(verdicts.statistic > verdicts.threshold)
    np.testing.assert_array_equal(verdicts.accepted, [True, False, True])


def test_a_missing_mode_is_found_in_the_residuals_and_noise_is_not() -> None:
    value = functions(PHI * [1.0, 0.1, 1.0], 0.01)
    found = likeliest_poles(F, refine(F, value, POLE[[0, 2]], "receptance"))
    assert np.abs(found[0] - POLE[1]) < 2.0 * np.abs(POLE[1].real)
    assert likeliest_poles(F, refine(F, value, POLE, "receptance")).size == 0


def test_variances_are_inflated_around_a_misfit_only() -> None:
    value = functions(PHI, 0.01)
    # The first mode a little different in half of the functions.
    other = functions(PHI * [1.0, 0.0, 0.0], 0.0) - functions(PHI * [0.0, 0.0, 0.0], 0.0)
    value[:5] += 0.2 * np.roll(other, 3, axis=1)[:5] - 0.2 * other[:5]
    inflation = variance_inflation(F, refine(F, value, POLE, "receptance"))
    assert inflation[0] > 2.0
    np.testing.assert_array_equal(inflation[1:], 1.0)


def test_a_split_mode_is_told_from_a_close_pair() -> None:
    near = np.append(POLE, POLE[2] * 1.002)
    fit = linear_fit(F, functions(PHI, 1e-3), near, "receptance")
    alike = fit.residue.copy()
    alike[:, 3] = 0.3 * alike[:, 2]
    assert is_split(replace(fit, residue=alike), -1)
    different = alike.copy()
    different[:, 3] = alike[::-1, 2] * np.where(np.arange(10) % 2, 1.0, -1.0)
    assert not is_split(replace(fit, residue=different), -1)
    assert not is_split(replace(fit, residue=alike), 0)


def test_a_pole_in_one_run_beside_another_is_confined() -> None:
    near = np.append(POLE, POLE[2] * 1.002)
    fit = linear_fit(F, functions(PHI, 1e-3), near, "receptance")
    residue = fit.residue.copy()
    residue[2:, 3] = 0.0
    run = np.arange(10) // 2
    alone = replace(fit, residue=residue, noise=np.ones(10))
    np.testing.assert_array_equal(is_confined(alone, run), [False, False, False, True])
    # Far from any other pole it may be a local mode; with one run there is nothing to compare.
    far = replace(alone, pole=np.append(POLE, POLE[2] * 1.2))
    assert not is_confined(far, run).any()
    assert not is_confined(alone, np.zeros(10, dtype=int)).any()
