"""The same input gives the same numbers, whatever the last digit of the data is."""

from dataclasses import replace
from pathlib import Path

import numpy as np

import ema
from ema.identify import identify_frf

CAMPAIGN = Path(__file__).parents[2] / "data/demo_stack/campaign.toml"
BOUND = 1e-10


def assert_same(first, second, name):
    first, second = np.asarray(first), np.asarray(second)
    np.testing.assert_allclose(second, first, rtol=BOUND, atol=BOUND * np.abs(first).max(), err_msg=name)


def test_the_last_digit_of_the_data_does_not_decide():
    """A pole that wanders off in the fit of a single run left the others, and the shapes, to rounding."""
    campaign = ema.read_campaign(CAMPAIGN)
    measurement = ema.read_measurement(campaign, "M1")
    frf, rng = measurement.frf, np.random.default_rng(0)
    digit = replace(frf, value=frf.value * (1.0 + 1e-15 * rng.standard_normal(frf.value.shape)))
    first, second = (
        identify_frf(f, measurement.geometry, name="M1", band=campaign.identification.band)
        for f in (frf, digit)
    )
    for name in ("frequency", "frequency_std", "damping", "run_pole", "shape", "shape_std"):
        assert_same(getattr(first, name), getattr(second, name), name)
