"""Sound files: rate, calibration, and what is wrong with them."""

import numpy as np
import pytest
from scipy.io import wavfile

import ema
from ema.io.array_histories import read_wav

RATE = 2560


@pytest.mark.parametrize(
    ("kind", "full", "middle"),
    [("int16", 2**15, 0), ("int32", 2**31, 0), ("uint8", 2**7, 2**7), ("float32", 1.0, 0)],
)
def test_samples_come_in_the_stated_unit_at_the_rate_of_the_header(tmp_path, kind, full, middle):
    share = np.column_stack([0.5 * np.sin(np.arange(400.0)), np.full(400, -0.25)])
    wavfile.write(tmp_path / "a.wav", RATE, (share * full + middle).astype(kind))
    force, response = read_wav(tmp_path / "a.wav", (500.0, 100.0))
    assert force.abscissa[1] == 1.0 / RATE
    np.testing.assert_allclose(force.value, 500.0 * share[:, 0], atol=500.0 / 127)
    np.testing.assert_allclose(response.value, -25.0, atol=100.0 / 127)
    both = read_wav(tmp_path / "a.wav", (2.0,))
    np.testing.assert_allclose(both[1].value, -0.5, atol=2.0 / 127)


def test_wrong_sound_files_say_what_and_where(tmp_path):
    path = tmp_path / "a.wav"
    wavfile.write(path, RATE, np.zeros((400, 2), np.int16))
    with pytest.raises(ema.MeasurementError, match=r"a.wav: has 2 channels, and 'full_scale' .* 3 numbers"):
        read_wav(path, (1.0, 2.0, 3.0))
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(ema.MeasurementError, match="cannot be read as a WAV file"):
        read_wav(path, (1.0,))
    path.write_text("no sound")
    with pytest.raises(ema.MeasurementError, match="cannot be read as a WAV file"):
        read_wav(path, (1.0,))


@pytest.mark.parametrize("keys", ["", "full_scale = 5\n", '[measurement.time]\nwindow = "boxcar"\n'])
def test_a_campaign_of_sound_files_asks_for_its_calibration(tmp_path, keys):
    (tmp_path / "points.csv").write_text("node,x,y,z\n1,0,0,0\n")
    wavfile.write(tmp_path / "a.wav", RATE, np.zeros((400, 2), np.int16))
    (tmp_path / "campaign.toml").write_text(
        f"""
[campaign]
name = "sound"
[points]
file = "points.csv"
unit = "mm"
[measurement]
{keys}
[[configuration]]
name = "M1"
files = ["a.wav"]
"""
    )
    with pytest.raises(ema.CampaignError, match=r"sound files \(.wav\) .* need 'full_scale'"):
        ema.read_campaign(tmp_path / "campaign.toml")
