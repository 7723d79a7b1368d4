"""Shares of the measured power: one definition, whatever band, channel and line."""

from dataclasses import replace

import numpy as np

from ema.identification.identify import identify_frf
from ema.quality.explained import check_explained, explained_power
from tests.unit.test_quality import bar


def identified(frf, geometry):
    return identify_frf(frf, geometry, name="a", band=(20.0, 499.5))


def test_a_share_is_of_the_power_of_all_channels():
    """A channel at rest around a mode has any misfit relative to itself: -768 % were printed of a sound mode."""
    measurement = bar()
    model = identified(measurement.frf, measurement.geometry)
    value = np.array(measurement.frf.value)
    near = np.abs(measurement.frf.frequency - model.frequency[1]) < 40
    value[4][..., near] *= 1e-3
    found = explained_power(replace(measurement.frf, value=value), model)
    assert found.share[4, 1] < -1.0
    assert 0.9 < found.around[1] <= 1.0
    np.testing.assert_allclose(found.power.sum(axis=1), 1.0)
    np.testing.assert_allclose(np.sum(found.power * found.share, axis=1), found.whole)
    np.testing.assert_allclose(np.mean(found.whole), found.mean)


def test_a_mode_that_explains_little_around_it_is_told_though_all_others_explain_enough():
    measurement = bar()
    model = identified(measurement.frf, measurement.geometry)
    value = np.array(measurement.frf.value)
    first = measurement.frf.frequency < 0.5 * (model.frequency[0] + model.frequency[1])
    value[..., first] *= 0.5  # the weakest of the three: all of it is off by its size
    found = explained_power(replace(measurement.frf, value=value), model)
    (verdict, *_) = check_explained(found, model)
    assert found.mean > 0.9
    assert found.around[0] < 0.1
    assert verdict.level == "warn"
    assert verdict.band[0] == found.edge[0]
