"""Campaign files for real measurements, as a user writes them: the example files are read with their data."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from ema import read_campaign, read_measurement

CAMPAIGNS = Path(__file__).parents[1] / "examples/campaigns"
REALDATA = Path(__file__).parents[2].parent / "shared/realdata"
pytestmark = pytest.mark.skipif(not REALDATA.exists(), reason=f"real measurements are not at {REALDATA}")


def test_beam_in_one_universal_file(tmp_path):
    shutil.copy(CAMPAIGNS / "beam.toml", tmp_path)
    (tmp_path / "beam.uff").symlink_to(REALDATA / "beam-uff-pyuff/beam.uff")
    campaign = read_campaign(tmp_path / "beam.toml")
    measurement = read_measurement(campaign, "free")
    frf = measurement.frf
    assert frf.value.shape == (3, 1, 64000)
    assert frf.quantity == "accelerance"
    np.testing.assert_allclose(np.diff(frf.frequency), 0.1, rtol=1e-9)
    np.testing.assert_array_equal(frf.input.node, [21])
    # the points have rotated displacement systems: what is called x there is not the global x
    np.testing.assert_allclose(
        frf.output.direction, [[-0.44807361612917, 0, 0.89399666360055785]] * 3, rtol=1e-12
    )
    np.testing.assert_array_equal(frf.input.direction, [[1, 0, 0]])
    peak = frf.band(140, 150)
    assert peak.frequency[np.argmax(np.abs(peak.value[0, 0]))] == pytest.approx(144.63, abs=0.1)


def test_roving_hammer_in_text_files(tmp_path):
    shutil.copy(CAMPAIGNS / "hammer.toml", tmp_path)
    shutil.copy(CAMPAIGNS / "hammer_points.csv", tmp_path / "points.csv")
    for file in (REALDATA / "beam-freefree-modelab").glob("*.gz"):
        (tmp_path / file.name).symlink_to(file)
    measurement = read_measurement(read_campaign(tmp_path / "hammer.toml"), "free")
    frf = measurement.frf
    assert frf.value.shape == (9, 1, 51201)
    np.testing.assert_array_equal(frf.output.node, np.arange(1, 10))
    np.testing.assert_array_equal(frf.input.direction, [[-1, 0, 0]])
    np.testing.assert_array_equal(frf.run, np.arange(9))
    peak = frf.band(300, 315)
    mode = np.argmax(np.abs(peak.value[:, 0]).sum(axis=0))
    assert peak.frequency[mode] == pytest.approx(306.86, abs=0.05)
    # accelerometer against the hammer: the driving point has the opposite sign of a usual one
    assert peak.value[3, 0, mode].imag < 0
