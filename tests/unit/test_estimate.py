"""FRFs from time histories: exact on noise-free data, with the bias that H1, H2 and Hv are known for.

FRFs from several forces at once: exact without noise, the bias of H1 and Hv, coherences, and what is refused.

Hits of a hammer: found in long records, double ones left out.
"""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import signal

from ema.campaign.estimate import (
    Averaging,
    clipped_share,
    cut_at_hits,
    double_hit,
    estimate_frf,
    estimate_frf_matrix,
    find_hits,
    pulse_samples,
    second_pulse,
)
from ema.campaign.reading import frfs_from_records
from ema.io.measured_function import MeasuredFunction
from ema.types.errors import MeasurementError

RATE = 1000.0
SYSTEM = signal.butter(2, [80, 120], "bandpass", fs=RATE)


def shaken(rng, n_sample, force_noise=0.0, response_noise=0.0):
    force = rng.normal(size=n_sample)
    response = signal.lfilter(*SYSTEM, force)
    noisy = force + force_noise * rng.normal(size=n_sample)
    return noisy[None], (response + response_noise * np.std(response) * rng.normal(size=n_sample))[None, None]


@pytest.mark.parametrize("estimator", ["H1", "H2", "Hv"])
def test_impacts_without_noise_are_exact(estimator):
    force = np.zeros((3, 2048))
    force[:, 20:25] = np.outer([1, 2, 3], [0.2, 0.8, 1, 0.7, 0.1])
    response = signal.lfilter(*SYSTEM, force)
    result = estimate_frf(force, response[None], RATE, Averaging(window="boxcar", estimator=estimator))
    expected = signal.freqz(*SYSTEM, worN=result.frequency, fs=RATE)[1]
    np.testing.assert_allclose(result.value[0], expected, atol=1e-6)
    np.testing.assert_allclose(result.coherence[0, 50:400], 1, rtol=1e-9)
    assert result.n_average == 3


def test_bias_of_the_estimators_with_noise_on_one_side():
    hann = {"window": "hann", "block_s": 1.0, "overlap": 0.5}
    band = slice(90, 110)
    truth = np.abs(signal.freqz(*SYSTEM, worN=np.arange(501.0), fs=RATE)[1])[band]

    def ratio(estimator, **noise):
        result = estimate_frf(
            *shaken(np.random.default_rng(1), 400_000, **noise), RATE, Averaging(estimator=estimator, **hann)
        )
        return np.mean(np.abs(result.value[0, band]) / truth), result

    assert ratio("H1", response_noise=0.7)[0] == pytest.approx(1, abs=0.01)
    assert ratio("H2", force_noise=0.7)[0] == pytest.approx(1, abs=0.01)
    # noise of 0.7 of the force adds 0.49 to its spectrum, which H1 divides by
    assert ratio("H1", force_noise=0.7)[0] == pytest.approx(1 / 1.49, abs=0.01)
    assert ratio("Hv", force_noise=0.7)[0] == pytest.approx(1 / np.sqrt(1.49), abs=0.01)
    _, result = ratio("H1", force_noise=0.7)
    assert result.coherence[0, band].mean() == pytest.approx(1 / 1.49, abs=0.02)
    assert result.n_average == 799


def test_the_decay_rate_of_the_exponential_window_is_stated():
    rate, n = 1000.0, 4000
    time = np.arange(n) / rate
    force = np.zeros((1, n))
    force[0, 0] = 1
    response = np.exp(-0.5 * time) * np.sin(2 * np.pi * 100 * time)
    averaging = Averaging(window="boxcar", response_end=0.01)
    result = estimate_frf(force, response[None, None], rate, averaging)
    assert result.coherence is None  # one average only
    assert result.decay_rate == pytest.approx(np.log(100) / 4)
    pole = -0.5 - result.decay_rate + 2j * np.pi * np.array([100, -100])
    z = np.exp(2j * np.pi * result.frequency / rate)
    exact = sum((z / (z - np.exp(p / rate))) / (2j * s) for p, s in zip(pole, (1, -1), strict=True))
    np.testing.assert_allclose(result.value[0], exact, atol=0.02 * np.abs(exact).max())


@pytest.mark.parametrize(
    ("averaging", "said"),
    [
        ({"window": "hann", "block_s": 3.0}, "is 3000 samples, but the records hold 2000"),
        ({"window": "boxcar", "force_s": 0.001}, "the force is zero"),
    ],
)
def test_impossible_estimates_are_refused(averaging, said):
    force = np.zeros((1, 2000))
    force[0, 500] = 1
    with pytest.raises(MeasurementError, match=said):
        estimate_frf(force, force[None], RATE, Averaging(**averaging))


def test_shapes_are_checked():
    with pytest.raises(MeasurementError, match=r"got \(2000,\) and"):
        estimate_frf(np.ones(2000), np.ones((1, 1, 2000)), RATE, Averaging(window="boxcar"))


def test_units_of_the_records_are_checked():
    with pytest.raises(ValidationError, match="response_unit: 'N' is not a unit of motion"):
        Averaging(window="hann", response_unit="N")


def test_clipped_share():
    wave = np.sin(2 * np.pi * np.arange(1000) / 100)
    assert clipped_share(wave) == 0
    assert clipped_share(np.clip(wave, -0.9, 0.9)) == pytest.approx(2 * np.arccos(0.9) / np.pi, abs=0.02)
    assert clipped_share(np.zeros(100)) == 0


def test_double_hit():
    pulse = np.exp(-(((np.arange(200) - 20) / 3) ** 2))
    assert double_hit(pulse) == 0
    assert double_hit(pulse + 0.3 * np.roll(pulse, 60)) == pytest.approx(0.3, abs=1e-3)


def test_a_force_gated_to_nothing_is_not_clipped():
    force = np.zeros(2000)
    force[100:103] = 0.3, 1.0, 0.4
    assert clipped_share(force) == 0.0
    force[100:108] = 0.3, 0.7, 1.0, 1.0, 1.0, 1.0, 0.8, 0.2
    assert clipped_share(force) == pytest.approx(4 / 2000)


def test_a_force_that_ends_amidst_blocks_is_refused():
    with pytest.raises(ValidationError, match="force_s is of records that are one block each"):
        Averaging(window="boxcar", block_s=1.0, force_s=0.5)


SYSTEMS = [[signal.butter(2, band, "bandpass", fs=RATE) for band in row] for row in
           [[(80, 120), (100, 200)], [(60, 90), (150, 180)], [(120, 160), (70, 110)]]]  # fmt: skip
RANDOM = {"window": "hann", "block_s": 1.0, "overlap": 0.5}


def shaken_by_two(rng, n_sample=200_000, *, shared=0.0, force_noise=0.0, response_noise=0.0):
    """Two forces, some of the second in the first, and three responses."""
    force = rng.normal(size=(2, n_sample))
    force[0] += shared * force[1]
    response = np.array([sum(signal.lfilter(*s, f) for s, f in zip(row, force, strict=True)) for row in SYSTEMS])
    response += response_noise * response.std(axis=1, keepdims=True) * rng.normal(size=response.shape)
    force += force_noise * rng.normal(size=force.shape)
    return force[:, None], response[:, None]


def truth(frequency):
    return np.array([[signal.freqz(*s, worN=frequency, fs=RATE)[1] for s in row] for row in SYSTEMS])


@pytest.mark.parametrize("estimator", ["H1", "Hv"])
@pytest.mark.parametrize("shared", [0.0, 2.0])
def test_forces_are_told_apart_even_where_they_share_much(estimator, shared):
    estimate = estimate_frf_matrix(
        *shaken_by_two(np.random.default_rng(1), shared=shared), RATE, Averaging(estimator=estimator, **RANDOM)
    )
    true = truth(estimate.frequency)
    band = slice(60, 200)  # leakage of the sharp flanks is what is left
    assert np.abs(estimate.value - true)[..., band].max() < 0.08
    # the first force is one part its own and four parts of the second
    np.testing.assert_allclose(estimate.independent[0, 1:-1].mean(), 1 / (1 + shared**2), atol=0.02)
    assert estimate.multiple_coherence[:, band].mean() > 0.99


def test_whole_transients_without_noise_are_exact():
    rng = np.random.default_rng(2)
    force = np.zeros((2, 4, 2048))
    force[:, :, 20:30] = rng.normal(size=(2, 4, 10))
    response = np.array([sum(signal.lfilter(*s, f) for s, f in zip(row, force, strict=True)) for row in SYSTEMS])
    for estimator in ("H1", "Hv"):
        estimate = estimate_frf_matrix(force, response, RATE, Averaging(window="boxcar", estimator=estimator))
        np.testing.assert_allclose(estimate.value, truth(estimate.frequency), atol=1e-5)
        # none of the two forces alone explains the responses
        assert estimate.partial_coherence[:, :, 150:350].min() > 0.99


def test_bias_of_the_estimators_with_noise():
    band = slice(85, 115)

    def ratio(estimator, **noise):
        data = shaken_by_two(np.random.default_rng(3), **noise)
        estimate = estimate_frf_matrix(*data, RATE, Averaging(estimator=estimator, **RANDOM))
        return np.mean(np.abs(estimate.value[0, 0, band] / truth(estimate.frequency)[0, 0, band]))

    assert ratio("H1", response_noise=0.7) == pytest.approx(1.0, abs=0.02)
    # noise of 0.7 of the force adds 0.49 to its spectrum, which H1 divides by; of a larger response Hv sees less of it
    assert ratio("H1", force_noise=0.7) == pytest.approx(1 / 1.49, abs=0.02)
    assert 1 / 1.49 < ratio("Hv", force_noise=0.7) < 1.05


def test_partial_coherence_tells_the_scatter_of_functions_of_forces_that_share_much():
    data = shaken_by_two(np.random.default_rng(3), 400_000, response_noise=0.3, shared=3.0)
    estimate = estimate_frf_matrix(*data, RATE, Averaging(**RANDOM))
    band = slice(85, 115)
    partial = estimate.partial_coherence[0, :, band]
    # Bendat and Piersol, Random Data, table 9.6, of real and imaginary part together
    predicted = np.sqrt((1 - partial) / partial / estimate.n_average)
    error = np.abs(estimate.value[0, :, band] / truth(estimate.frequency)[0, :, band] - 1)
    assert np.sqrt(np.mean(error**2) / np.mean(predicted**2)) == pytest.approx(1.0, abs=0.3)


def test_one_force_is_the_special_case():
    force, response = shaken_by_two(np.random.default_rng(4), response_noise=0.3)
    for estimator in ("H1", "Hv"):
        averaging = Averaging(estimator=estimator, **RANDOM)
        several = estimate_frf_matrix(force[:1], response, RATE, averaging)
        one = estimate_frf(force[0], response, RATE, averaging)
        np.testing.assert_allclose(several.value[:, 0], one.value, rtol=1e-6)
        np.testing.assert_allclose(several.multiple_coherence, one.coherence, atol=1e-9)
        np.testing.assert_allclose(several.partial_coherence[:, 0], one.coherence, atol=1e-9)


def refusal(force, response, **averaging):
    with pytest.raises(MeasurementError) as error:
        estimate_frf_matrix(force, response, RATE, Averaging(**averaging))
    return str(error.value)


def test_what_does_not_tell_forces_apart_is_refused():
    force, response = shaken_by_two(np.random.default_rng(5), 20_000)
    assert "2 averages do not tell the parts of 2 forces" in refusal(force, response, window="hann", block_s=10.0)
    same = np.stack([force[0], 2 * force[0]])
    assert "the 2 forces are the same up to a factor" in refusal(same, response, **RANDOM)
    assert "force 2 of 2 is zero" in refusal(force * [[[1]], [[0]]], response, **RANDOM)
    assert "H2 is not defined for 2 forces" in refusal(force, response, estimator="H2", **RANDOM)


def channels(kinds, value):
    return tuple(
        MeasuredFunction(
            kind=kind,
            abscissa=np.arange(value.shape[1]) / RATE,
            value=one,
            quantity=None if kind == "force" else "accelerance",
            output=(k, 3),
            input=None,
            source=f"run.uff: data set {k}",
        )
        for k, (kind, one) in enumerate(zip(kinds, value, strict=True), start=1)
    )


def test_records_of_two_shakers_give_each_response_over_each_force():
    force, response = shaken_by_two(np.random.default_rng(6), 100_000, shared=2.0)
    value = np.concatenate([force, response])[:, 0]
    kinds = ("force", "force", "response", "response", "response")
    notes = []
    found = frfs_from_records([(Path("run.uff"), channels(kinds, value))], Averaging(**RANDOM), notes)
    assert [(f.output, f.input) for f, *_ in found] == [((o, 3), (i, 3)) for o in (3, 4, 5) for i in (1, 2)]
    band = slice(60, 200)
    np.testing.assert_allclose(found[3][0].value[band], truth(found[3][0].abscissa)[1, 1, band], atol=0.1)
    assert found[3][1].kind == "coherence"
    assert "2 forces at once, 199 averages: of its power they explain 1.00" in notes[0]
    assert "80 % of a force is in the others, too" in notes[1]


def test_the_positions_of_several_forces_may_be_stated():
    force, response = shaken_by_two(np.random.default_rng(6), 100_000)
    value = np.concatenate([response[:1], force, response[1:]])[:, 0]
    averaging = Averaging(force=(2, 3), **RANDOM)
    found = frfs_from_records([(Path("run.csv"), channels(("response",) * 5, value))], averaging, [])
    assert [(f.output, f.input) for f, *_ in found] == [((o, 3), (i, 3)) for o in (1, 4, 5) for i in (2, 3)]


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
            kind=kind, abscissa=np.arange(one.size) / RATE, value=one, output=(1, 3), input=None,
            quantity=None if kind == "force" else "accelerance", source=f"a.uff: data set {k}",
        )
        for k, (kind, one) in enumerate(zip(("force", "response"), value, strict=True), start=1)
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


@pytest.mark.parametrize("wrong", [{"block_s": None}, {"block_s": 0.04}, {"window": "hann"}, {"overlap": 0.5}])
def test_what_does_not_go_with_hits_is_refused(wrong):
    with pytest.raises(ValidationError, match="before_hit_s, of hits, needs"):
        Averaging(**({"window": "boxcar", "block_s": 1.0, "before_hit_s": 0.05} | wrong))


@pytest.mark.parametrize(("width", "samples"), [(1, 1), (3, 3), (12, 12)])
def test_the_samples_of_a_pulse(width, samples):
    force = np.zeros(500)
    force[100 : 100 + width] = 1.0
    assert pulse_samples(force) == samples
    assert pulse_samples(np.sin(np.arange(500.0))) == 0
