"""Repeats of one condition are compared, and their scatter is told beside what the intervals say."""

import numpy as np
import pytest

from ema import Comparison, Configuration, repeats


def configuration(name, **state):
    stated = {"stack": "4", "torque": 2.5, "pressure": None, "height": None, **state}
    return Configuration(name=name, files=(), **stated)


def comparison(names, frequency):
    frequency = np.array(frequency)
    return Comparison(
        name=names,
        frequency=frequency,
        frequency_std=np.where(np.isnan(frequency), np.nan, 1e-5 * frequency),
        damping=np.where(np.isnan(frequency), np.nan, 0.01),
        damping_std=np.where(np.isnan(frequency), np.nan, 1e-4),
        mac=np.ones_like(frequency),
    )


def test_repeats_that_differ_by_more_than_their_intervals_are_told():
    # 0.35 % apart with intervals of 0.001 %: nothing compared them
    names = ("A", "B", "A again")
    states = [configuration("A"), configuration("B", torque=5.0), configuration("A again")]
    rows = [[200.0, 300.0, 400.0], [220.0, 330.0, np.nan], [200.7, 300.0, np.nan]]
    (found,) = repeats(states, comparison(names, rows))
    assert found.name == ("A", "A again")
    np.testing.assert_allclose(found.frequency, [200.35, 300.0])
    np.testing.assert_allclose(found.scatter, [0.7 / np.sqrt(2), 0.0], atol=1e-12)
    np.testing.assert_allclose(found.stated, [2e-3, 3e-3], rtol=2e-3)
    assert found.finding.startswith("A, A again state the same condition: frequencies scatter by 0.12 %")
    assert "0.25 % at 200.35 Hz" in found.finding


@pytest.mark.parametrize("states", [({"torque": None}, {"torque": None}), ({}, {"stack": "5"})])
def test_what_states_no_condition_or_another_one_is_no_repeat(states):
    configurations = [configuration(name, **state) for name, state in zip("AB", states, strict=True)]
    assert repeats(configurations, comparison(("A", "B"), [[200.0], [201.0]])) == ()


def test_repeats_without_a_common_mode():
    rows = [[200.0, np.nan], [np.nan, 300.0]]
    (found,) = repeats([configuration("A"), configuration("B")], comparison(("A", "B"), rows))
    assert found.finding == "A, B state the same condition, but share no mode"
