"""Runs that differ, and a mode beside another one that only makes them seem to.

The scatter between runs and what it makes of the interval of their mean.
"""

import numpy as np
import pytest

from ema.identification.functions import Functions
from ema.identification.run_poles import moves_from_run_to_run
from ema.modal.runs import run_scatter, std_with_scatter

N_RUN, SENSORS = 8, 2
RUN = np.repeat(np.arange(N_RUN), SENSORS)
LINES = np.arange(60.0, 140.0, 0.25)
NONE = np.empty(0, dtype=complex)


def pole(frequency, damping=0.01):
    return 2.0 * np.pi * np.asarray(frequency) * (1j * np.sqrt(1.0 - damping**2) - damping)


def functions(poles, residue, noise=1e-3):
    """Receptances of modes whose poles are those of each run, (n_run, n_mode), with noise."""
    rng = np.random.default_rng(7)
    s = 2j * np.pi * LINES
    one = np.asarray(poles)[RUN]
    value = np.sum(
        residue[..., None] / (s - one[..., None]) + residue.conj()[..., None] / (s - one.conj()[..., None]), axis=1
    )
    scatter = rng.standard_normal(value.shape) + 1j * rng.standard_normal(value.shape)
    value += noise * np.sqrt(np.mean(np.abs(value) ** 2, axis=1, keepdims=True)) * scatter
    return Functions(frequency=LINES, value=value, run=RUN, quantity="receptance", weight=np.ones_like(value.real))


def residues(*size):
    """Modal constants of real shapes, of modes that answer with such sizes."""
    shape = np.random.default_rng(3).standard_normal((RUN.size, len(size)))
    return -1j * shape * np.array(size)


@pytest.mark.parametrize("apart", [0.7, 1.5])
def test_a_mode_beside_another_one_is_no_shift_of_it(apart):
    true = pole([100.0, 100.0 + apart])
    data = functions(np.tile(true, (N_RUN, 1)), residues(1.0, 0.3))
    fit = data.linear_fit(true[:1])
    moves, beside = moves_from_run_to_run(data, fit, 0, NONE)
    assert not moves
    np.testing.assert_allclose(np.sort(beside.pole.imag), true.imag, rtol=1e-4)


def test_a_mode_that_moves_is_told_from_one_beside_it():
    true = pole([100.0 + 0.1 * np.sin(np.arange(N_RUN)), 110.0 + np.zeros(N_RUN)]).T
    data = functions(true, residues(1.0, 0.3))
    fit = data.linear_fit(true.mean(axis=0))
    assert moves_from_run_to_run(data, fit, 0, NONE)[0]
    assert moves_from_run_to_run(data, fit, 1, NONE) == (False, None)


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
