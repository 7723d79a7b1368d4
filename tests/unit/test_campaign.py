"""The campaign file: what it holds arrives in SI, what is wrong with it is said with its key."""

import numpy as np
import pytest

from ema.campaign.campaign import read_campaign
from ema.types.errors import CampaignError

POINTS = "node,x,y,z\n1,0,0,0\n2,100,0,0\n3,200,0,0\n"
TEXT = """
[campaign]
name = "Stack 4"

[structure]
stack = "stack.toml"

[points]
file = "points.csv"
unit = "mm"
lines = [[1, 2, 3]]

[measurement]
unit = "g/N"
[measurement.table]
layout = "real-imaginary"

[[configuration]]
name = "M1"
stack = 4
torque_Nm = 1.5
pressure_kPa = 160
height_mm = 64.8
files = ["run*.csv"]
output = ["1+z", "2-x"]
input = ["3+Z"]

[[configuration]]
name = "M2"
[[configuration.run]]
files = ["run2.csv", "run10.csv"]
output = [{node = 1, direction = [0, 3, 4]}]
input = ["3+z"]

[[correction]]
files = "run2.csv"
scale = -1
reason = "upside down"

[identification]
band_Hz = [30, 1100]
order = 60
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "points.csv").write_text(POINTS)
    for name in ("run10.csv", "run2.csv"):
        (tmp_path / name).write_text("1,2,3\n")
    (tmp_path / "campaign.toml").write_text(TEXT)
    return tmp_path


def test_what_the_file_says(folder):
    campaign = read_campaign(folder / "campaign.toml")
    assert campaign.name == "Stack 4"
    assert campaign.stack == folder / "stack.toml"
    np.testing.assert_allclose(campaign.geometry.coordinate[:, 0], [0, 0.1, 0.2])
    np.testing.assert_array_equal(campaign.geometry.line, [[1, 2], [2, 3]])
    assert campaign.identification.band == (30, 1100)
    assert campaign.identification.order == 60
    first, second = campaign.configurations
    assert (first.name, first.stack, first.torque, first.pressure) == ("M1", "4", 1.5, 160e3)
    assert first.height == pytest.approx(64.8e-3)
    assert second.torque is None
    (files,) = first.files
    assert [f.name for f in files.files] == ["run2.csv", "run10.csv"]  # natural order
    assert not files.together
    assert files.output == ((1, (0, 0, 1)), (2, (-1, 0, 0)))
    assert second.files[0].together
    np.testing.assert_allclose(second.files[0].output[0].direction, [0, 0.6, 0.8])
    assert campaign.corrections[0].scale == -1


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("torque_Nm", "torque", r"\[1\].torque: unknown key; did you mean 'torque_Nm'\? Allowed: name"),
        ("[identification]", "[identify]", "identify: unknown key; did you mean 'identification'"),
        ("layout =", "layuot =", "measurement.table.layuot: unknown key; did you mean 'layout'"),
        ('layout = "real-imaginary"', 'layout = "polar"', "table.layout: .*'real-imag.*found 'polar'"),
        ('name = "Stack 4"', "", "campaign.name: this key is missing"),
        ('"2-x"', '"2x"', "output.2.: '2x' is not a DOF: write .* such as '12.z'"),
        ('unit = "g/N"', 'unit = "g"', "unit 'g' is not a response over a force"),
        ('unit = "g/N"', 'unit = "gee/N"', "the unit 'gee/N' is not understood at 'gee'"),
        ('unit = "g/N"', "", "text files need 'unit' and"),
        ('unit = "mm"', 'unit = "kN"', "points.unit: 'kN' is not a unit of length"),
        ('unit = "mm"', "", "points.unit: a list of points needs its unit"),
        ("[[1, 2, 3]]", "[[1, 2, 9]]", r"points.lines: no such points: \[9\]"),
        ('["run*.csv"]', '["ruin2.csv"]', "'M1': files: no file 'ruin2.csv' .*did you mean run2.csv"),
        ('["run*.csv"]', "[]", "give either 'files'"),
        ("[30, 1100]", "[1100, 30]", "band_Hz must be .lower, upper."),
        ('name = "M2"', 'name = "M1"', "names must be unique"),
        ("torque_Nm = 1.5", "torque_Nm = ", "not a TOML file"),
        ('reason = "upside down"', "", r"correction\[1\].reason: this key is missing"),
        ("direction = [0, 3, 4]", "direktion = [0, 3, 4]", r"output\[1\]: .* is not a DOF"),
    ],
)  # fmt: skip
def test_faults_are_named(folder, old, new, said):
    assert old in TEXT
    (folder / "campaign.toml").write_text(TEXT.replace(old, new))
    with pytest.raises(CampaignError, match=said) as fault:
        read_campaign(folder / "campaign.toml")
    assert str(folder / "campaign.toml") in str(fault.value)


def test_a_folder_in_place_of_its_file(folder):
    with pytest.raises(CampaignError, match=r"is a folder; give a file, such as .*campaign\.toml"):
        read_campaign(folder)


def test_a_configuration_that_is_not_there(folder):
    campaign = read_campaign(folder / "campaign.toml")
    with pytest.raises(CampaignError, match=r"no configuration 'M12'; did you mean 'M2' or 'M1'\? Allowed: M1, M2"):
        campaign.configuration("M12")


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(CampaignError, match="cannot be read"):
        read_campaign(tmp_path / "campaign.toml")
