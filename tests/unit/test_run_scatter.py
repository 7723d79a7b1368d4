"""The scatter between runs and what it makes of the interval of their mean."""

import numpy as np

from ema.modal.runs import run_scatter, std_with_scatter


def test_runs_that_agree_within_their_noise_do_not_scatter():
    value = np.array([[1.0], [1.01], [0.99]])
    assert run_scatter(value, np.full((3, 1), 0.1)) == [0.0]
    assert run_scatter(value, np.full((3, 1), np.inf)) == [0.0]


def test_scatter_is_what_noise_does_not_explain():
    rng = np.random.default_rng(0)
    std = rng.uniform(0.01, 0.1, (2000, 1))
    value = 5.0 + 0.2 * rng.standard_normal(std.shape) + std * rng.standard_normal(std.shape)
    np.testing.assert_allclose(run_scatter(value, std), 0.2, rtol=0.05)


def test_intervals_of_few_runs_hold():
    rng = np.random.default_rng(1)
    std = np.full((5, 4000), 0.1)
    value = 0.3 * rng.standard_normal(std.shape) + std * rng.standard_normal(std.shape)
    scatter = run_scatter(value, std)
    mean = np.average(value, axis=0, weights=1.0 / (std**2 + scatter**2))
    held = np.mean(np.abs(mean) < 1.96 * std_with_scatter(std[0] / np.sqrt(5), std, scatter))
    assert 0.92 < held < 0.97  # 0.50 by the noise alone


def test_modes_that_no_run_determines_keep_their_intervals():
    none = np.full((3, 1), np.inf)
    assert std_with_scatter(np.array([0.2]), none, np.zeros(1)) == [0.2]
