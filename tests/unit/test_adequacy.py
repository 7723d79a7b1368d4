"""How likely a misfit is, per block of data."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import kstest

from updating.diagnosis.adequacy import block_p_value, p_value
from updating.diagnosis.residual import Residual

KIND = np.array(["frequency"] * 8 + ["damping"] * 6 + ["shape"] * 30 + ["prior"] * 4)
LABEL = np.where(KIND == "shape", [f"M1, mode {1 + i // 10}" for i in range(-14, KIND.size - 14)], "")
JACOBIAN = np.column_stack([np.random.default_rng(3).normal(size=(KIND.size, 5)), np.zeros(KIND.size)])


def fitted(data, jacobian=JACOBIAN, weak=()):
    """Return what a linear fit leaves of data."""
    left = data - jacobian @ np.linalg.lstsq(jacobian, data, rcond=None)[0]
    nothing = np.zeros(0)
    found = Residual(
        value=left,
        jacobian=jacobian,
        kind=KIND,
        label=tuple(LABEL.tolist()),
        log_frequency=nothing,
        log_frequency_std=nothing,
        partner=nothing.astype(int),
        mixing=(),
        weak=weak,
    )
    return SimpleNamespace(residual=found)


@pytest.mark.parametrize("kind", ["frequency", "damping", "shape", "prior"])
def test_probabilities_are_uniform_where_nothing_is_missing(kind):
    rng = np.random.default_rng(4)
    found = [block_p_value(fitted(rng.normal(size=KIND.size)), kind) for _ in range(400)]
    assert kstest(found, "uniform").pvalue > 0.01


def test_few_data_that_misfit_are_not_lost_among_many():
    data = np.where(KIND == "frequency", 3.0, 0.0) * np.array([1.0, -1.0] * (KIND.size // 2))
    data[KIND == "shape"] = np.random.default_rng(5).normal(size=30)
    own = fitted(data, JACOBIAN[:, :1])
    assert block_p_value(own, "frequency") < 1e-6
    assert p_value(own) == pytest.approx(7.0 * block_p_value(own, "frequency"))


def test_one_shape_that_misfits_is_not_lost_among_all_unless_it_is_weak():
    data = np.random.default_rng(7).choice([-1.0, 1.0], KIND.size) * np.where(LABEL == "M1, mode 2", 2.2, 0.3)
    assert block_p_value(fitted(data), "shape") > 0.05
    assert p_value(fitted(data)) < 0.01
    assert p_value(fitted(data, weak=("M1, mode 2",))) > 0.05


@pytest.mark.parametrize("kind", ["frequency", "damping", "prior"])
def test_one_value_that_is_far_off_is_not_lost_among_its_kind(kind):
    data = np.random.default_rng(9).choice([-0.3, 0.3], KIND.size)
    data[np.flatnonzero(kind == KIND)[2]] = 4.5
    own = fitted(data, JACOBIAN[:, :1])
    assert p_value(own) < 0.01
    calm = np.where(np.abs(data) > 1.0, 0.3, data)
    assert p_value(fitted(calm, JACOBIAN[:, :1])) > 0.5


def test_a_weak_shape_that_is_far_off_does_not_judge_all():
    data = np.random.default_rng(8).normal(size=KIND.size) * np.where(LABEL == "M1, mode 2", 9.0, 0.5)
    column = JACOBIAN[:, :1]
    assert block_p_value(fitted(data, column), "shape") < 1e-6
    assert p_value(fitted(data, column, weak=("M1, mode 2",))) > 0.05


def test_data_that_are_all_fitted_say_nothing():
    jacobian = np.zeros((KIND.size, 6))
    jacobian[KIND == "damping"] = np.eye(6)
    assert block_p_value(fitted(np.random.default_rng(6).normal(size=KIND.size), jacobian), "damping") == 1.0
