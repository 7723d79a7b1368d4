"""FRFs from time histories: exact on noise-free data, with the bias that H1, H2 and Hv are known for."""

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import signal

from ema.campaign.estimate import Averaging, clipped_share, double_hit, estimate_frf
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
