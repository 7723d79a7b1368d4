"""Runs of two states of a structure are told from runs of one, on sets of 44 channels with faults injected."""

from dataclasses import replace

import numpy as np
import pytest

from ema.quality.channels import check, usable
from ema.quality.structure import run_states
from ema.types.errors import MeasurementError
from tests.recovery.test_identify import block
from tests.recovery.test_quality_faults import FAULTS, inject, plate, shifted


def in_other_state(measurement, runs, factor):
    """Return the measurement with all resonances of some runs at other frequencies by a factor."""
    frf = measurement.frf
    value, frequency = np.array(frf.value), frf.frequency
    for channel in np.flatnonzero(np.isin(frf.run, runs)):
        one = value[channel, 0]
        value[channel, 0] = np.interp(frequency / factor, frequency, one.real) + 1j * np.interp(
            frequency / factor, frequency, one.imag
        )
    return replace(measurement, frf=replace(frf, value=value))


def states(measurement):
    return [v for v in check(measurement) if v.check == "states" and v.level != "pass"]


@pytest.mark.parametrize(
    ("runs", "reported"), [(range(11), "12 to 22"), (range(0, 22, 2), "2, 4, 6, 8"), ((3, 7, 8), "4, 8 to 9")]
)
def test_runs_of_two_states_are_named_and_refused(runs, reported):
    mixed = in_other_state(plate(np.random.default_rng([6, 3])), list(runs), 1.2)
    (found,) = states(mixed)
    assert found.level == "fail"
    assert f"runs {reported}" in found.message
    with pytest.raises(MeasurementError, match="two states of the structure"):
        usable(mixed, check(mixed))


@pytest.mark.parametrize("seed", range(6))
def test_runs_of_one_state_are_not_divided(seed):
    """Nor where a channel is at fault, or where sensors shift resonances by 0.6 %."""
    rng = np.random.default_rng([5, seed])
    measurement = plate(rng)
    if seed % 3 == 1:
        measurement = shifted(measurement, rng, 0.006)
    if seed % 3 == 2:
        measurement, _ = inject(measurement, FAULTS[seed % len(FAULTS)], rng)
    assert states(measurement) == []


def test_a_few_runs_of_broad_resonances_are_no_other_state():
    """Their sensors let some peaks stand out and others not; most runs show fewer than can be compared."""
    rng = np.random.default_rng(8)
    frequency = np.arange(50.0, 500.0)
    places = [(100.0, 200.0, 300.0)] * 2 + [(150.0, 250.0, 350.0)] * 2 + [(120.0,)] * 6
    rows = [
        sum(frequency**2 / (f**2 - frequency**2 + 0.04j * f * frequency) for f in places[run])
        for run in np.repeat(np.arange(10), 2)
    ]
    value = np.array(rows) * (1.0 + 1e-3 * rng.standard_normal((20, frequency.size)))
    frf = replace(block(frequency, value), run=np.repeat(np.arange(10), 2))
    assert list(run_states(frf, np.arange(20))) == []
    four = replace(block(frequency, value[:8]), run=np.repeat(np.arange(4), 2))
    assert [v.level for v in run_states(four, np.arange(8))] == ["fail"]
