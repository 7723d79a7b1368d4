"""A free decay through all amplitudes of a mode that softens."""

import numpy as np
import pytest

from ema.identification.amplitude import ring_down
from ema.types.errors import MeasurementError

RATE = 4000.0
FREQUENCY = np.array([60.0, 95.0])
SHAPE = np.array([[1.0, 0.8], [0.5, -1.0], [-0.7, 0.6]])


def decay(drop, damping=0.004, noise=0.0, duration=2.0):
    """Displacements of three channels in two modes, whose frequency is lower by drop a**2 at amplitude a from 1 on."""
    omega, time = 2 * np.pi * FREQUENCY[:, None], np.arange(0, duration, 1 / RATE)
    envelope = np.exp(-damping * omega * time)
    phase = omega * time - drop * (1 - envelope**2) / (2 * damping)  # the integral of the frequency
    q = np.array([[1.0], [0.5]]) * envelope * np.cos(phase)
    return SHAPE @ q + noise * np.random.default_rng(0).standard_normal((3, time.size))


def follow(record, mode=0, **given):
    return ring_down(
        record,
        RATE,
        **{"shape": SHAPE, "frequency": FREQUENCY, "mode": mode, "quantity": "receptance", **given},
    )


def test_a_linear_decay_has_one_frequency_and_damping():
    for mode in range(2):
        found = follow(decay(0.0), mode)
        np.testing.assert_allclose(found.frequency, FREQUENCY[mode], rtol=1e-4)
        np.testing.assert_allclose(found.damping, 0.004, rtol=3e-2)


def test_a_softening_mode_is_followed_down_its_backbone():
    found = follow(decay(0.03, noise=1e-3))
    assert found.amplitude[0] > 3 * found.amplitude[-1]
    expected = FREQUENCY[0] * (1 - 0.03 * found.amplitude**2)
    np.testing.assert_allclose(found.frequency, expected, rtol=1e-3)
    assert found.frequency[0] < 0.992 * FREQUENCY[0]
    np.testing.assert_allclose(found.damping, 0.004, rtol=0.15)


def test_amplitude_is_displacement_whatever_was_measured():
    record = decay(0.0)
    spectrum = np.fft.rfft(record)
    omega = 2 * np.pi * np.fft.rfftfreq(record.shape[1], 1 / RATE)
    velocity = np.fft.irfft(1j * omega * spectrum, record.shape[1])
    first, second = follow(record), follow(velocity, quantity="mobility")
    np.testing.assert_allclose(second.amplitude[2:-2], first.amplitude[2:-2], rtol=2e-2)


def test_one_channel_is_filtered_by_its_band_alone():
    found = follow(decay(0.0)[:1], shape=SHAPE[:1])
    np.testing.assert_allclose(found.frequency, FREQUENCY[0], rtol=1e-3)


def test_noise_at_the_end_is_not_fitted():
    found = follow(decay(0.0, damping=0.02, noise=5e-3))
    assert found.amplitude.size < 0.5 * follow(decay(0.0, damping=0.002)).amplitude.size
    np.testing.assert_allclose(found.damping, 0.02, rtol=0.2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"shape": SHAPE[:2]}, "3 channels, shapes of 2 channels and 2 modes"),
        ({"frequency": FREQUENCY[:1]}, "and 1 frequencies do not belong together"),
    ],
)
def test_what_does_not_fit_is_refused(change, message):
    with pytest.raises(MeasurementError, match=message):
        follow(decay(0.0, duration=0.2), **change)


def test_a_record_that_is_too_short_is_refused():
    with pytest.raises(MeasurementError, match="too short, or too noisy, for a mode at 60 Hz"):
        follow(decay(0.0, duration=0.2))
