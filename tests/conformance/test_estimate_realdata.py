"""Five real hammer blows through a campaign file of time histories."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import find_peaks

from ema import read_campaign, read_measurement

CAMPAIGNS = Path(__file__).parents[1] / "examples/campaigns"
REALDATA = Path(__file__).parents[2].parent / "shared/realdata"
pytestmark = pytest.mark.skipif(not REALDATA.exists(), reason=f"real measurements are not at {REALDATA}")


@pytest.fixture
def folder(tmp_path):
    shutil.copy(CAMPAIGNS / "blows.toml", tmp_path)
    (tmp_path / "points.csv").write_text("node,x,y,z\n1,0,0,0\n")
    for k in range(1, 6):
        record = np.load(REALDATA / f"impact-repeats-pyfrf/measurements_{k}.npy")
        np.savetxt(tmp_path / f"blow{k}.csv", record.T, delimiter=",", fmt="%.9g")
    return tmp_path


def test_blows_become_one_frf(folder):
    measurement = read_measurement(read_campaign(folder / "blows.toml"), "free")
    frf = measurement.frf
    assert frf.value.shape == (1, 1, 12801)
    assert frf.quantity == "accelerance"
    assert measurement.overload == pytest.approx(0)
    assert not any("double hit" in note for note in measurement.notes)
    low = frf.band(100, 5000)
    assert np.median(low.coherence) > 0.995
    magnitude = np.abs(low.value[0, 0])
    peaks = low.frequency[find_peaks(magnitude, height=50, distance=50)[0]]
    for found in (810.4, 900.1, 2640, 3670, 4126, 4393):
        assert np.abs(peaks - found).min() < 3  # the lines are 1 Hz apart, and the response is cut off
    assert np.abs(frf.band(5, 15).value).mean() == pytest.approx(1.4, abs=0.3)
