"""Every key of a campaign file goes through the command line: what the reader accepts, the commands can store."""

import json

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from updating.commands.command_line import app

pytestmark = pytest.mark.usefixtures("all_undrawn")
N = 10
FREQUENCY = np.arange(60.0, 240.0, 0.5)
BASE = """
[campaign]
name = "keys"
[points]
file = "points.csv"
unit = "mm"
lines = [[1, 2, 3]]
[measurement]
format = "csv"
unit = "(m/s2)/N"
[measurement.table]
layout = "real-imaginary"
[[configuration]]
name = "M1"
stack = 4
torque_Nm = 1.5
pressure_kPa = 160
height_mm = 64.8
force_N = 2
files = ["set.csv"]
output = ["1+z", "2+z", "3+z", "4+z", "5+z", "6+z", "7+z", "8+z", "9+z", "10+z"]
input = ["1+z"]
[identification]
band_Hz = [60, 240]
order = 8
"""


@pytest.fixture
def folder(tmp_path):
    """A folder with the functions of a bar of two modes, and its points."""
    x = np.linspace(0, 1, N)
    omega, one = 2 * np.pi * FREQUENCY, 2 * np.pi * np.array([110.0, 190.0])
    shape = np.cos(np.pi * np.outer(x, [2, 3])) + 0.1
    value = (shape * shape[0]) @ (-(omega**2) / (one[:, None] ** 2 - omega**2 + 0.02j * one[:, None] * omega))
    rng = np.random.default_rng(0)
    value = value + 0.01 * (rng.normal(size=value.shape) + 1j * rng.normal(size=value.shape))
    columns = [FREQUENCY, *(part for v in value for part in (v.real, v.imag))]
    np.savetxt(tmp_path / "set.csv", np.column_stack(columns), delimiter=",")
    rows = [f"{n},{800 * at},0,0" for n, at in zip(range(1, N + 1), x, strict=True)]
    (tmp_path / "points.csv").write_text("\n".join(["node,x,y,z", *rows]))
    return tmp_path


def identified(folder, more=""):
    """Run `lamella ema` on the base campaign and more keys; return what it stored of the campaign and the modes."""
    (folder / "campaign.toml").write_text(BASE + more)
    done = CliRunner().invoke(app, ["ema", str(folder / "campaign.toml"), "-o", str(folder / "out")])
    assert done.exception is None, done.output
    assert done.exit_code == 0, done.output
    stored = [folder / "out" / name for name in ("campaign.json", "M1/modal_model.json")]
    return [json.loads(path.read_text(encoding="utf-8"))["result"] for path in stored]


def test_the_keys_of_a_plain_campaign(folder):
    campaign, modes = identified(folder)
    assert campaign["corrections"] == []
    np.testing.assert_allclose(modes["frequency"], [110.0, 190.0], rtol=1e-3)


@pytest.mark.parametrize(
    ("keys", "n_output"),
    [
        ("", 10),
        ('files = "set.csv"', 10),
        ("function = 3\nscale = -1", 10),
        ('output = "4+z"\nnew_output = "4-z"', 10),
        ('new_input = "1-z"', 10),
        ('output = "5+z"\nexclude = true', 9),
    ],
)
def test_the_keys_of_a_correction(folder, keys, n_output):
    campaign, modes = identified(folder, f'[[correction]]\nreason = "why"\n{keys}\n')
    (correction,) = campaign["corrections"]
    assert correction["reason"] == "why"
    assert any(file.endswith("set.csv") for file in correction["files"])
    assert len(modes["node"]) == n_output
    np.testing.assert_allclose(modes["frequency"], [110.0, 190.0], rtol=1e-3)


def test_a_stated_mass_of_the_sensors_is_taken_out_and_said(folder):
    (folder / "campaign.toml").write_text(BASE.replace("[measurement]", "[measurement]\nsensor_mass_g = 2", 1))
    done = CliRunner().invoke(app, ["ema", str(folder / "campaign.toml"), "-o", str(folder / "out")])
    assert done.exit_code == 0, done.output
    found = json.loads((folder / "out/M1/modal_model.json").read_text(encoding="utf-8"))["result"]
    # one run with ten sensors: each adds 2 g times its squared shape, 1/kg, to a modal mass of 1
    load = 2e-3 * np.sum((np.cos(np.pi * np.outer(np.linspace(0, 1, N), [2, 3])) + 0.1) ** 2, axis=0)
    np.testing.assert_allclose(found["frequency"], np.array([110.0, 190.0]) * (1 + 0.5 * load), rtol=2e-3)
    assert found["sensor_mass"] == pytest.approx(2e-3)
    assert "those of the structure without the sensors (2 g each, as stated)" in " ".join(done.output.split())


def windowed(folder, time_constant):
    """Run `lamella ema` on the base campaign with an exponential window stated."""
    text = BASE.replace("[measurement]", f"[measurement]\nexponential_window_s = {time_constant}", 1)
    (folder / "windowed.toml").write_text(text)
    return CliRunner().invoke(app, ["ema", str(folder / "windowed.toml"), "-o", str(folder / "windowed")])


def test_the_damping_of_an_exponential_window_is_taken_out(folder):
    """A window exp(-t / T) moves every pole by -1 / T: the bar has 1 % with it."""
    rate = 2.0
    done = windowed(folder, 1.0 / rate)
    assert done.exit_code == 0, done.output
    found = json.loads((folder / "windowed/M1/modal_model.json").read_text(encoding="utf-8"))["result"]
    _, plain = identified(folder)
    omega = 2 * np.pi * np.array([110.0, 190.0])
    np.testing.assert_allclose(plain["damping"], 0.01, rtol=0.02)
    np.testing.assert_allclose(np.subtract(plain["damping"], found["damping"]), rate / omega, rtol=1e-3)
    np.testing.assert_allclose(found["frequency"], plain["frequency"], rtol=1e-4)
    np.testing.assert_allclose(found["error"], plain["error"])


def test_a_window_that_cannot_be_is_an_error(folder):
    done = windowed(folder, 0.01)
    assert done.exit_code != 0
    assert "exponential window alone" in str(done.exception)


def test_a_force_level(folder):
    level = '[[configuration.force_level]]\nforce_N = 10\nfiles = ["set.csv"]\n'
    campaign, _ = identified(folder, "")
    text = BASE.replace("[identification]", level + "[identification]")
    (folder / "campaign.toml").write_text(text)
    done = CliRunner().invoke(app, ["ema", str(folder / "campaign.toml"), "-o", str(folder / "levels")])
    assert done.exit_code == 0, done.output
    stored = json.loads((folder / "levels/campaign.json").read_text(encoding="utf-8"))["result"]
    assert [c["force"] for c in stored["configurations"][0]["force_levels"]] == [10.0]
    assert campaign["configurations"][0]["force_levels"] == []


def test_the_keys_of_arrays_and_of_points_without_coordinates(folder):
    table = np.loadtxt(folder / "set.csv", delimiter=",")
    with h5py.File(folder / "set.h5", "w") as file:
        file["f"], file["re"], file["im"] = table[:, 0], table[:, 1::2], table[:, 2::2]
        file["coherence"], file["points"] = np.full((len(table), N), 0.99), np.arange(1, N + 1)
    text = BASE.partition("[measurement]")[0].replace("lines =", "without_coordinates = [99]\nlines =")
    text += """[measurement]
format = "hdf5"
unit = "(m/s2)/N"
[measurement.variables]
real = "re"
imaginary = "im"
axes = ["frequency", "output"]
frequency = "f"
coherence = "coherence"
output_point = "points"
output_direction = "+z"
input_point = 99
input_direction = "+z"
[[configuration]]
name = "M1"
files = ["set.h5"]
[identification]
band_Hz = [60, 240]
order = 8
"""
    (folder / "campaign.toml").write_text(text)
    done = CliRunner().invoke(app, ["ema", str(folder / "campaign.toml"), "-o", str(folder / "out")])
    assert done.exit_code == 0, done.output
    campaign, modes = (
        json.loads((folder / "out" / name).read_text(encoding="utf-8"))["result"]
        for name in ("campaign.json", "M1/modal_model.json")
    )
    assert campaign["variables"]["input_point"] == 99
    assert campaign["without_coordinates"] == [99]
    np.testing.assert_allclose(modes["frequency"], [110.0, 190.0], rtol=1e-3)
