"""Hits of a hammer: found in long records, double ones left out."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import signal

from ema.campaign.estimate import Averaging, cut_at_hits, find_hits, pulse_samples, second_pulse
from ema.campaign.reading import frfs_from_records
from ema.io.measured_function import MeasuredFunction
from ema.types.errors import MeasurementError

RATE = 1000.0
SYSTEM = signal.butter(2, [80, 120], "bandpass", fs=RATE)
PULSE = np.array([0.1, 0.5, 1.0, 0.7, 0.2])
AVERAGING = Averaging(window="boxcar", block_s=1.0, before_hit_s=0.05)


def record(hits, n_sample=10_000, noise=1e-3, offset=0.02):
    """Force and response to pulses of given height at given samples."""
    force = np.zeros(n_sample)
    for sample, height in hits:
        force[sample : sample + PULSE.size] += height * PULSE
    rng = np.random.default_rng(1)
    response = signal.lfilter(*SYSTEM, force)
    return np.stack([force + offset + noise * rng.normal(size=n_sample), response])


def estimated(value, averaging=AVERAGING):
    channels = tuple(
        MeasuredFunction(
            kind=kind, abscissa=np.arange(own.size) / RATE, value=own, output=(1, 3), input=None,
            quantity=None if kind == "force" else "accelerance", source=f"a.uff: data set {k}",
        )
        for k, (kind, own) in enumerate(zip(("force", "response"), value, strict=True), start=1)
    )  # fmt: skip
    notes = []
    ((frf, coherence, _, _),) = frfs_from_records([(Path("a.uff"), channels)], averaging, notes)
    return frf, coherence, notes


def test_hits_are_found_whatever_their_height_in_an_offset():
    force, _ = record([(500, 50.0), (2200, 20.0), (4000, 90.0)])
    np.testing.assert_allclose(find_hits(force, 1000), [501, 2201, 4001], atol=1)


def test_hits_in_one_record_are_averaged_and_double_ones_are_not():
    good = [(500, 50.0), (2200, 30.0), (4000, 60.0)]
    # a second pulse after, a smaller one before, and a hit at the end
    bad = [(5500, 50.0), (5580, 20.0), (7400, 15.0), (7460, 50.0), (9500, 50.0)]
    frf, coherence, notes = estimated(record(good + bad, offset=0.0))
    truth = signal.freqz(*SYSTEM, worN=frf.abscissa, fs=RATE)[1]
    band = slice(80, 121)
    np.testing.assert_allclose(frf.value[band], truth[band], atol=0.01)
    assert coherence.value[band].min() > 0.999
    assert "5 hits are found; 1 more whose block is not whole are left out" in notes[0]
    assert [note.split(" is left out")[0] for note in notes[1:]] == ["a.uff: hit 4 of 5", "a.uff: hit 5 of 5"]


def test_second_pulses_before_and_after_the_main_one():
    force = record([(500, 50.0)], 1000, offset=0.0)[0]
    assert second_pulse(force) == 0.0
    assert second_pulse(record([(500, 50.0), (600, 20.0)], 1000)[0]) == pytest.approx(0.4, abs=0.02)
    assert second_pulse(record([(500, 50.0), (400, 20.0)], 1000)[0]) == pytest.approx(0.4, abs=0.02)


def test_a_periodic_force_is_no_double_hit():
    assert second_pulse(np.sin(0.3 * np.arange(1000))) == 0.0


def test_records_of_one_hit_each_are_refused_where_all_are_double():
    with pytest.raises(MeasurementError, match="all 1 hits are double"):
        estimated(record([(500, 50.0), (600, 20.0)], 2000), Averaging(window="boxcar"))


def test_records_without_a_whole_hit_are_refused():
    with pytest.raises(MeasurementError, match=r"a.uff: no hit with a whole block of 1000 samples"):
        estimated(record([(10, 50.0)]))


def test_blocks_begin_before_the_hit():
    blocks, left_out = cut_at_hits(record([(500, 50.0), (9900, 50.0)])[None], 1000, 50)
    assert blocks.shape == (1, 2, 1000)
    assert left_out == 1
    assert abs(int(np.argmax(blocks[0, 0])) - 51) <= 1


@pytest.mark.parametrize(
    "wrong", [{"block_s": None}, {"block_s": 0.04}, {"window": "hann"}, {"overlap": 0.5}]
)
def test_what_does_not_go_with_hits_is_refused(wrong):
    with pytest.raises(ValidationError, match="before_hit_s, of hits, needs"):
        Averaging(**({"window": "boxcar", "block_s": 1.0, "before_hit_s": 0.05} | wrong))


@pytest.mark.parametrize(("width", "samples"), [(1, 1), (3, 3), (12, 12)])
def test_the_samples_of_a_pulse(width, samples):
    force = np.zeros(500)
    force[100 : 100 + width] = 1.0
    assert pulse_samples(force) == samples
    assert pulse_samples(np.sin(np.arange(500.0))) == 0
