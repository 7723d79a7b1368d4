"""Estimates of G_f and d_f on functions whose answer is known."""

import numpy as np
import pytest

from updating.fitting.fit import Estimate, estimate_damping, estimate_stiffness
from updating.results.text import estimate_text, parameter_text

A = np.array([10.0, 17.0, 30.0])


def predict(G_f):
    """Frequencies that grow with the root of the stiffness."""
    return A * np.sqrt(G_f), A / (2 * np.sqrt(G_f))


def test_stiffness_is_found_from_anywhere_within_the_bounds():
    for truth in (25.0, 1100.0, 40_000.0):
        found = estimate_stiffness(predict, predict(truth)[0], np.zeros(3), bounds=(20.0, 50_000.0))
        assert found.value == pytest.approx(truth, rel=1e-8)
        assert not found.at_bound


def test_stiffness_is_the_minimum_of_opt_G_for_contradicting_data():
    target = predict(1000.0)[0] * [1.1, 0.9, 1.0]
    found = estimate_stiffness(predict, target, np.zeros(3), bounds=(20.0, 50_000.0))
    around = [np.linalg.norm(predict(found.value * k)[0] - target) for k in (0.999, 1.0, 1.001)]
    assert np.argmin(around) == 1
    assert found.objective == pytest.approx(around[1])
    assert found.objective <= found.history[:, 1].min() * (1 + 1e-9)


def test_a_value_beyond_the_bounds_is_said_to_lie_on_the_bound():
    found = estimate_stiffness(predict, predict(1e6)[0], np.zeros(3), bounds=(20.0, 50_000.0))
    assert found.at_bound
    assert found.value == pytest.approx(50_000.0, rel=1e-4)


def test_standard_deviation_is_the_scatter_over_repeated_measurements():
    rng = np.random.default_rng(1)
    truth, noise = predict(1000.0)[0], 10.0  # far above the error of the model's form
    found = [
        estimate_stiffness(predict, truth + noise * rng.standard_normal(3), np.full(3, noise), bounds=(100.0, 10_000.0))
        for _ in range(300)
    ]
    # Three values estimate the scatter poorly, and only an excess over the noise counts: somewhat too wide on average.
    ratio = np.mean([e.std for e in found]) / np.std([e.value for e in found])
    assert 0.95 < ratio < 1.35


def test_no_interval_is_narrower_than_the_error_of_the_models_form():
    target = predict(1000.0)[0]
    found = estimate_stiffness(predict, target, np.full(3, 1e-6), bounds=(100.0, 10_000.0))
    # 0.1 % of each frequency is 0.2 % of a stiffness that frequencies grow with the root of, and three share it.
    assert found.std / found.value == pytest.approx(2e-3 * np.sqrt(np.sum(A**4)) / np.sum(A**2), rel=1e-3)
    assert estimate_text(found) == "1000.0 ± 2.9"


def test_damping_is_the_linear_least_squares_solution():
    slope = np.array([1e8, 3e8, 2e8])
    target = np.array([0.012, 0.029, 0.022])
    found = estimate_damping(slope, target, np.zeros(3), bounds=(0.0, 1e-8))
    assert found.value == pytest.approx(np.linalg.lstsq(slope[:, None], target, rcond=None)[0][0])
    assert found.objective == pytest.approx(found.history[:, 1].min())
    assert not found.at_bound


def test_negative_damping_is_held_at_zero():
    found = estimate_damping(np.array([1e8, 1e8]), np.array([-0.01, -0.02]), np.zeros(2), bounds=(0.0, 1e-8))
    assert found.value == 0.0
    assert found.at_bound


def estimate(value, std, **given):
    default = {"name": "G_f", "unit": "Pa/Pa", "lower": 20.0, "upper": 5e4, "at_bound": False, "objective": 0.0}
    return Estimate(**default | given, value=value, std=std, history=np.zeros((1, 2)))


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (1480.4, 12.2, "1480 ± 24"),
        (1480.4, 0.61, "1480.4 ± 1.2"),
        (5.02e-11, 1e-12, "(5.02 ± 0.20)e-11"),
        (1480.4, 0.0, "1480"),
        (1480.4, np.inf, "1480"),
    ],
)
def test_what_stands_behind_the_sign_is_half_of_the_95_percent_interval(value, std, text):
    assert estimate_text(estimate(value, std)) == text


def test_a_parameter_at_the_bound_of_its_range_says_so():
    assert parameter_text(estimate(5e4, 0.0, at_bound=True)) == "G_f = 5e+04 Pa/Pa (at the bound of its range)"
    assert parameter_text(estimate(1480.4, 12.2)) == "G_f = 1480 ± 24 Pa/Pa"
