"""What an explanation says of modes that it has not seen."""

import numpy as np
import pytest

from updating.diagnosis.held_out import held_out_error
from updating.diagnosis.residual import Residual

RNG = np.random.default_rng(5)
STD = np.array([2e-4, 3e-4, 5e-4, 1e-3])


def residual(jacobian, data):
    """Return what a linear fit of four modes of a frequency, a damping ratio and two shape values leaves."""
    left = data - jacobian @ np.linalg.lstsq(jacobian, data, rcond=None)[0]
    return Residual(
        value=left,
        jacobian=-jacobian,
        kind=np.array(["frequency", "damping", "shape", "shape"] * 4),
        label=tuple(f"M1, mode {1 + i // 4}" for i in range(16)),
        log_frequency=left[::4] * STD,
        log_frequency_std=STD,
        partner=np.arange(4),
        mixing=(),
        weak=(),
    )


def test_it_is_what_a_fit_to_all_other_modes_leaves():
    jacobian, data = RNG.normal(size=(16, 3)), RNG.normal(size=16)
    expected = []
    for mode in range(4):
        other = np.arange(16) // 4 != mode
        fitted = np.linalg.lstsq(jacobian[other], data[other], rcond=None)[0]
        expected.append(abs(np.expm1(-STD[mode] * (data - jacobian @ fitted)[4 * mode])))
    assert held_out_error(residual(jacobian, data)) == pytest.approx(np.mean(expected), rel=1e-9)


def test_a_mode_without_which_a_parameter_is_unknown_is_passed_over():
    jacobian = RNG.normal(size=(16, 1))
    own = np.zeros((16, 1))
    own[0] = 1.0
    data = RNG.normal(size=16)
    known = residual(np.hstack([jacobian, own]), data)
    assert np.isfinite(held_out_error(known))
    assert np.isnan(held_out_error(residual(np.eye(16)[:, ::4], data)))


def test_a_prediction_that_fails_altogether_has_an_error_all_the_same():
    """A parameter that the other modes hardly tell, and data that no model is near to."""
    jacobian = np.full((16, 1), 1e-3)
    jacobian[0] = 1.0
    assert 0.5 < held_out_error(residual(jacobian, 1e6 * RNG.normal(size=16))) < 2.0
