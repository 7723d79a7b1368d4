"""What a treatment changes, from differences: slopes, their intervals, and several stacks together."""

import numpy as np
import pytest

from tests.studies.published.treatments import Shift, Treatment, slope, together, treatments_csv


def shift(value, half):
    return Shift(value=value, lower=value - half, upper=value + half)


def test_a_slope_has_its_interval_in_95_of_100_cases():
    rng = np.random.default_rng(1)
    x, hits = np.array([0.1, 0.3, 0.4, 0.2]), 0
    for _ in range(1000):
        found = slope(x, 0.5 * x + 0.05 * rng.standard_normal(4), 1e-6)
        hits += found.lower < 0.5 < found.upper
    assert 930 < hits < 970


def test_modes_that_agree_by_chance_are_no_surer_than_two_assemblies():
    found = slope(np.array([0.2, 0.2, 0.2]), np.array([0.1, 0.1, 0.1]), 4e-3)
    assert found.value == pytest.approx(0.5)
    assert found.upper - found.value == pytest.approx(4.303 * 4e-3 / np.sqrt(0.12), rel=1e-3)


def test_what_was_not_measured_is_left_out_and_nothing_is_made_of_one_mode():
    nan = float("nan")
    assert slope(np.array([0.2, nan, 0.4]), np.array([0.1, 1.0, 0.2]), 1e-6).value == pytest.approx(0.5)
    assert np.isnan(slope(np.array([0.2]), np.array([0.1]), 1e-6).value)


def test_stacks_that_differ_widen_the_interval():
    close, apart = (together([shift(0.1, 0.1), shift(0.12, 0.1)]), together([shift(-0.5, 0.1), shift(0.72, 0.1)]))
    assert close.value == pytest.approx(apart.value)
    assert apart.upper - apart.lower > 10.0 * (close.upper - close.lower)


def test_a_treatment_is_stated_as_the_paper_states_it():
    one = Treatment(
        name="lubricant",
        pairs=(("16", "8"),),
        stiffness=shift(0.0, 0.1),
        damping=shift(np.log(1.5), 0.2),
        exponent=shift(float("nan"), 0.0),
        published=(("16 against 8", np.log(0.985), np.log(1.36)),),
    )
    assert one.sentence.startswith("lubricant (16 against 8): G_f +0 % (-10 to +11), d_f +50 % (+23 to +83)")
    assert "Table 6, 16 against 8: G_f -2 %, d_f +36 %" in one.sentence
    assert "as much as 150 %" in one.sentence
    assert treatments_csv([one]).decode().splitlines()[1].startswith("lubricant,16/8,0,-0.09516,0.1052,0.5,")
