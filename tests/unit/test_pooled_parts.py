"""Whose an effect is of which each specimen has its own: the rig's, if all have much the same."""

from types import SimpleNamespace

import numpy as np
import pytest

from updating.fitting.estimate import ParameterEstimate
from updating.pooled.parts import _means, _scatter
from updating.pooled.specimen import Level
from updating.pooled.term import Term

BENCH = SimpleNamespace(effects={"clamp_inertia": None})
EACH = Term(effect="clamp_inertia", level=Level(kind="each", of="", members=(0, 1, 2, 3)))


def estimates(*strength, station=0.2):
    """Two parameters of each specimen: a strength and where it acts."""
    return tuple(
        ParameterEstimate(
            name=f"{name}[S{s + 1}]", unit="1", value=value, lower=value, upper=value, at_bound=False
        )
        for s, own in enumerate(strength)
        for name, value in (("inertia", own), ("station", station * (-1) ** s))
    )


def test_much_the_same_in_all_specimens_is_the_rigs():
    assert _scatter(BENCH, EACH, estimates(2.0, 2.2, 1.8, 2.0)) == pytest.approx(0.0816, abs=1e-4)


@pytest.mark.parametrize("strength", [(2.0, 1.0, 3.0, 2.0), (2.0, -2.0, 2.0, -2.0), (0.0, 0.0, 0.0, 2.0)])
def test_other_values_or_signs_are_each_ones_own(strength):
    assert np.isnan(_scatter(BENCH, EACH, estimates(*strength)))


def test_two_specimens_are_too_few_and_contact_is_never_the_rigs():
    two = Term(effect="clamp_inertia", level=Level(kind="each", of="", members=(0, 1)))
    assert np.isnan(_scatter(BENCH, two, estimates(2.0, 2.0)))
    contact = Term(effect="G_f", level=EACH.level)
    assert np.isnan(_scatter(BENCH, contact, estimates(2.0, 2.0, 2.0, 2.0)))


def test_the_mean_has_the_interval_that_the_scatter_gives():
    inertia, station = _means(estimates(2.0, 2.2, 1.8, 2.0), 4)
    assert (inertia.name, station.name) == ("inertia", "station")
    # Student's t of three degrees of freedom, 3.182, over the root of four specimens
    half = 3.182 * np.std([2.0, 2.2, 1.8, 2.0], ddof=1) / 2.0
    assert (inertia.value, inertia.lower, inertia.upper) == pytest.approx(
        (2.0, 2.0 - half, 2.0 + half), abs=1e-3
    )
    assert station.value == pytest.approx(0.0)
