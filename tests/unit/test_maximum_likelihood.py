"""The refinement's Jacobian, end point and covariance.

Lines weigh by what a fit leaves of them.
"""

from __future__ import annotations

import numpy as np
import pytest

from ema.identification.functions import misfit_weight
from ema.identification.maximum_likelihood import linear_fit, refine
from ema.identification.mode_columns import mode_basis

F = np.arange(50.0, 350.0, 0.5)
POLE = 2 * np.pi * np.array([100.0, 104.0, 240.0]) * (-0.01 + 1j)


def functions(seed: int, noise: float, n: int = 6) -> np.ndarray:
    rng = np.random.default_rng(seed)
    residue = rng.standard_normal((n, 3)) + 0.1j * rng.standard_normal((n, 3))
    s = 2j * np.pi * F
    value = residue @ (1 / (s - POLE[:, None])) + residue.conj() @ (1 / (s - POLE.conj()[:, None]))
    scatter = rng.standard_normal(value.shape) + 1j * rng.standard_normal(value.shape)
    return value + noise * np.sqrt(np.mean(np.abs(value) ** 2)) * scatter / np.sqrt(2)


def test_poles_of_clean_functions_are_exact_from_a_poor_start() -> None:
    start = POLE * np.array([1.004, 0.997, 1.001]) + np.array([-3.0, 2.0, -5.0])
    fit = refine(F, functions(0, 0.0), start, "receptance")
    np.testing.assert_allclose(fit.pole, POLE, rtol=1e-9)


def test_refinement_ends_where_the_likelihood_is_largest() -> None:
    value = functions(1, 0.02)
    fit = refine(F, value, POLE, "receptance")
    std = np.sqrt(np.diag(fit.pole_covariance))
    for k in range(6):
        for sign in (-1.0, 1.0):
            step = np.zeros(6)
            step[k] = sign * std[k]
            moved = linear_fit(F, value, fit.pole + step[0::2] + 1j * step[1::2], "receptance")
            # One standard deviation along an axis loses at least half a unit of log-likelihood.
            assert moved.objective - fit.objective > 0.45


def test_sensitivity_of_the_residues_is_their_derivative() -> None:
    value = functions(2, 1e-6)
    fit = linear_fit(F, value, POLE, "receptance")
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-4
        moved = linear_fit(F, value, POLE + step[0::2] + 1j * step[1::2], "receptance")
        change = (moved.residue - fit.residue) / 1e-4
        parts = np.stack([change.real, change.imag], axis=-1).reshape(6, 6)
        np.testing.assert_allclose(fit.sensitivity[:, :, k], parts, atol=2e-3 * np.abs(fit.sensitivity).max())


def test_derivative_columns_are_the_derivative_of_the_basis() -> None:
    step = 1e-3
    moved, base = (mode_basis(F, POLE + d, "accelerance") for d in (step, -step))
    derivative = mode_basis(F, POLE, "accelerance", power=2)
    scale = np.abs(derivative).max(axis=0)
    np.testing.assert_allclose((moved - base) / (2.0 * step) / scale, derivative / scale, atol=1e-6)


def test_scatter_over_seeds_is_what_the_covariance_says() -> None:
    poles, covariances, residues, residue_variances = [], [], [], []
    clean = functions(3, 0.0)
    rms = np.sqrt(np.mean(np.abs(clean) ** 2))
    for seed in range(200):
        rng = np.random.default_rng([9, seed])
        scatter = rng.standard_normal(clean.shape) + 1j * rng.standard_normal(clean.shape)
        fit = refine(F, clean + 0.02 * rms * scatter / np.sqrt(2), POLE, "receptance")
        poles.append(np.stack([fit.pole.real, fit.pole.imag], axis=1).ravel())
        covariances.append(fit.pole_covariance)
        residues.append(np.stack([fit.residue.real, fit.residue.imag], axis=-1).reshape(6, 6))
        residue_variances.append(np.diagonal(fit.residue_covariance(), axis1=1, axis2=2))
    # A variance of 200 samples scatters by 10 %; four of that.
    ratio = np.var(poles, axis=0) / np.diag(np.mean(covariances, axis=0))
    np.testing.assert_allclose(ratio, 1.0, atol=0.4)
    ratio = np.var(residues, axis=0) / np.mean(residue_variances, axis=0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.45)


def test_noise_is_estimated_function_by_function() -> None:
    value = functions(4, 0.0)
    sigma = np.array([1.0, 2.0, 4.0, 1.0, 1.0, 8.0]) * 1e-4
    rng = np.random.default_rng(5)
    scatter = rng.standard_normal(value.shape) + 1j * rng.standard_normal(value.shape)
    fit = refine(F, value + sigma[:, None] * scatter / np.sqrt(2), POLE, "receptance")
    # 600 complex lines each: 4 % standard deviation of a variance, 2 % of its root.
    np.testing.assert_allclose(fit.noise, sigma, rtol=0.1)


N_LINE = 4000


@pytest.mark.parametrize(("noise", "error"), [(1e-3, 0.1), (1e-2, 0.01), (1e-4, 0.0)])
def test_noise_and_relative_error_are_found(noise, error):
    rng = np.random.default_rng(1)
    value = 10.0 ** rng.uniform(-3.0, 0.0, (2, N_LINE)) + 0j
    std = np.hypot(noise, error * np.abs(value))
    residual = std * (rng.standard_normal((2, 2, N_LINE)).T @ [1.0, 1j]).T / np.sqrt(2.0)
    off = np.log(misfit_weight(value, residual) * std**2)
    # 4000 values tell a variance to 2 %, but fewer of them each of its parts
    assert np.std(off) < 0.1


def test_weights_are_of_geometric_mean_1():
    rng = np.random.default_rng(2)
    value, residual = rng.standard_normal((2, 3, 200)) * [[[1.0]], [[0.1]]] + 0j
    np.testing.assert_allclose(np.mean(np.log(misfit_weight(value, residual)), axis=1), 0.0, atol=1e-12)


def test_blocks_of_the_covariance_are_those_of_all_of_it():
    rng = np.random.default_rng(3)
    value = np.stack([np.ones(F.size) / (2j * np.pi * F - p) for p in POLE])
    value = value + 0.01 * (rng.normal(size=value.shape) + 1j * rng.normal(size=value.shape))
    fit = linear_fit(F, value, POLE, "receptance")
    whole = fit.residue_covariance()
    for r in range(POLE.size):
        one = whole[:, 2 * r : 2 * r + 2, 2 * r : 2 * r + 2]
        np.testing.assert_allclose(fit.covariance_of_each()[:, r], one, rtol=1e-10)


def test_what_a_fit_does_not_hold_is_made_anew():
    rng = np.random.default_rng(4)
    value = np.stack([np.ones(F.size) / (2j * np.pi * F - p) for p in POLE])
    value = value + 0.01 * (rng.normal(size=value.shape) + 1j * rng.normal(size=value.shape))
    held = linear_fit(F, value, POLE, "receptance")
    without = linear_fit(F, value, POLE, "receptance", with_residual=False)
    assert without.residual.size == 0
    rows = slice(1, 3)
    np.testing.assert_allclose(
        without.left(rows, F, value, "receptance"), held.left(rows, F, value, "receptance"), atol=1e-12
    )


def test_the_covariance_of_lines_that_weigh_alike_is_that_of_weights_beside_one() -> None:
    # one sums the information over functions at once, the other adds a matrix for each
    value = functions(4, 0.02)
    alike = linear_fit(F, value, POLE, "receptance")
    beside = linear_fit(F, value, POLE, "receptance", np.full(value.shape, 1.0 + 1e-12))
    np.testing.assert_allclose(alike.pole_covariance, beside.pole_covariance, rtol=1e-6)
