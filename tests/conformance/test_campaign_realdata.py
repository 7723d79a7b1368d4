"""Campaign files for real measurements, as a user writes them: the example files are read with their data."""

import io
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from ema import check, read_campaign, read_measurement

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
    np.testing.assert_allclose(frf.output.direction, [[-0.44807361612917, 0, 0.89399666360055785]] * 3, rtol=1e-12)
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
    np.testing.assert_array_equal(frf.run, np.zeros(9))  # one sensor stays
    peak = frf.band(300, 315)
    mode = np.argmax(np.abs(peak.value[:, 0]).sum(axis=0))
    assert peak.frequency[mode] == pytest.approx(306.86, abs=0.05)
    # accelerometer against the hammer: the driving point has the opposite sign of a usual one
    assert peak.value[3, 0, mode].imag < 0


def test_building_saved_as_complex_text(tmp_path):
    with zipfile.ZipFile(REALDATA / "building-3storey-iqs/experimental_building_frf.zip") as archive:
        name = next(n for n in archive.namelist() if n.endswith(".npz"))
        value = np.load(io.BytesIO(archive.read(name)))["data"]
    rows = ["; ".join(f"({v.real:.9g}{v.imag:+.9g}j)" for v in row) for row in value]
    (tmp_path / "frf.txt").write_text("\n".join(rows))
    floors = ["node,x,y,z"]
    floors += [f"{10 * side + k},0,{0.3 * side},{0.18 * (3 - k)}" for side in (1, 2) for k in range(4)]
    (tmp_path / "points.csv").write_text("\n".join(floors))
    (tmp_path / "campaign.toml").write_text("""
[campaign]
name = "Three-storey building"
[points]
file = "points.csv"
unit = "m"
without_coordinates = [99]
[measurement]
unit = "(m/s2)/N"
[measurement.table]
layout = "complex"
delimiter = "semicolon"
axis_column = 0
axis_step = 0.0625
[[configuration]]
name = "free"
files = ["frf.txt"]
output = ["99+x", "10+x", "11+x", "12+x", "13+x", "20+x", "21+x", "22+x", "23+x"]
input = ["99+x"]
[identification]
band_Hz = [18, 97]
""")
    campaign = read_campaign(tmp_path / "campaign.toml")
    measurement = read_measurement(campaign, "free")
    np.testing.assert_allclose(measurement.frf.value[:, 0], value.T, rtol=1e-8)
    peak = measurement.frf.band(45, 55)
    assert peak.frequency[np.argmax(np.abs(peak.value).sum(axis=(0, 1)))] == pytest.approx(50.01, abs=0.2)
    # the driving-point sensor points the other way, which nothing in the data says but their power
    failed = [v for v in check(measurement, campaign.identification.band) if v.level == "fail"]
    assert [(v.check, v.channel) for v in failed] == [("sign", (0,))]


def test_ruler_as_matlab_wrote_it(tmp_path):
    shutil.copy(REALDATA / "ruler-freefree-pydvma/ruler_grid_acc_3.mat", tmp_path / "ruler.mat")
    content = scipy.io.loadmat(tmp_path / "ruler.mat")
    step = content["freq"].item() / 2 / (len(content["yspec"]) - 1)  # "freq" is the sampling rate
    (tmp_path / "points.csv").write_text("node,x,y,z\n" + "".join(f"{k},{k},0,0\n" for k in range(1, 11)))
    (tmp_path / "campaign.toml").write_text(f"""
[campaign]
name = "Ruler"
[points]
file = "points.csv"
unit = "cm"
without_coordinates = [11]
[measurement]
unit = "m/s2/N"
[measurement.variables]
frf = "yspec"
axes = ["frequency", "input"]
axis_step = {step!r}
output_point = 11
output_direction = "+z"
[[configuration]]
name = "free"
files = ["ruler.mat"]
input = ["1+z", "2+z", "3+z", "4+z", "5+z", "6+z", "7+z", "8+z", "9+z", "10+z"]
""")
    measurement = read_measurement(read_campaign(tmp_path / "campaign.toml"), "free")
    np.testing.assert_array_equal(measurement.frf.value[:, 0], content["yspec"].T)
    np.testing.assert_array_equal(measurement.frf.output.node, np.arange(1, 11))


def test_ruler_converted_from_matlab(tmp_path):
    content = scipy.io.loadmat(REALDATA / "ruler-freefree-pydvma/ruler_grid_acc_3.mat")
    value = content["yspec"]
    frequency = np.linspace(0, content["freq"].item() / 2, len(value))  # "freq" is the sampling rate
    parts = np.stack([np.abs(value), np.rad2deg(np.angle(value))], axis=2).reshape(len(value), -1)
    np.savetxt(tmp_path / "ruler.csv", np.column_stack([frequency, parts])[:1100], delimiter=",", fmt="%.9g")
    (tmp_path / "points.csv").write_text("node,x,y,z\n" + "".join(f"{k},{k},0,0\n" for k in range(1, 11)))
    (tmp_path / "campaign.toml").write_text("""
[campaign]
name = "Ruler"
[points]
file = "points.csv"
unit = "cm"
without_coordinates = [11]
[measurement]
unit = "m/s2/N"
[measurement.table]
layout = "magnitude-phase"
[[configuration]]
name = "free"
files = ["ruler.csv"]
output = ["11+z"]
input = ["1+z", "2+z", "3+z", "4+z", "5+z", "6+z", "7+z", "8+z", "9+z", "10+z"]
""")
    measurement = read_measurement(read_campaign(tmp_path / "campaign.toml"), "free")
    assert measurement.frf.value.shape == (10, 1, 1100)
    np.testing.assert_allclose(measurement.frf.value[:, 0], value[:1100].T, rtol=1e-6)
    assert not [v for v in check(measurement, (5, 620)) if v.level == "fail"]
