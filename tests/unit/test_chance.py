"""What the best of many effects explains by chance."""

import numpy as np
import pytest
from scipy.stats import chi2
from updating.diagnosis.chance import chance_of_gain

from model import Parameter
from updating.diagnosis.screening import Screened

RNG = np.random.default_rng(7)


def effect(name, column, lower):
    parameter = Parameter(
        name=name, unit="1", nominal=0.5, lower=lower, upper=1.0, neutral=0.0, source="test"
    )
    nothing = np.zeros(1)
    return Screened(
        effect=name,
        parameter=(parameter,),
        coordinate=nothing,
        column=column,
        strength=np.array([0]),
        gain=0.0,
        start=nothing,
        reach=9.0,
    )


@pytest.mark.parametrize(("lower", "share"), [(-1.0, 1.0), (0.0, 0.5)])
def test_one_effect_follows_chi_square(lower, share):
    found = chance_of_gain([effect("a", RNG.normal(size=(40, 1)), lower)], 4.0)
    assert found == pytest.approx(share * chi2.sf(4.0, 1), rel=0.15)


def test_the_best_of_many_explains_more_and_twins_count_once():
    columns = np.linalg.qr(RNG.normal(size=(40, 8)))[0]
    many = [effect(f"e{i}", 3.0 * columns[:, [i]], -1.0) for i in range(8)]
    assert chance_of_gain(many, 4.0) == pytest.approx(1.0 - chi2.cdf(4.0, 1) ** 8, rel=0.05)
    twins = [effect(f"t{i}", (1.0 + i) * columns[:, [0]], -1.0) for i in range(8)]
    assert chance_of_gain(twins, 4.0) == pytest.approx(chi2.sf(4.0, 1), rel=0.15)


def test_without_effects_all_is_chance():
    assert chance_of_gain([], 16.0) == 1.0
