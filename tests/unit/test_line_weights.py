"""Lines weigh by what a fit leaves of them."""

import numpy as np
import pytest

from ema.identification.functions import misfit_weight

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
