"""Campaigns of specimens: what their file may hold, and what is said of one that is wrong."""

from pathlib import Path

import numpy as np
import pytest

from ema.types.errors import MeasurementError
from updating.errors import FitError
from updating.pooled.campaign_file import has_specimens, read_specimens, specimens_of
from updating.pooled.specimen import Specimen, levels_of

DATA = Path(__file__).parents[2] / "data" / "hidden_effect"
HEAD = """
[campaign]
name = "two stacks"
[structure]
stack = "stack.toml"
[points]
file = "points.csv"
unit = "mm"
"""
FIRST = """
[[specimen]]
name = "S1"
height_mm = 63
notes = {treatment = "glued"}
[specimen.material]
young_GPa = 190
[[specimen.configuration]]
name = "M1"
pressure_kPa = 160
modes = "modes.csv"
shapes = "shapes.csv"
force = "1+z"
"""
SECOND = """
[[specimen]]
name = "S2"
[[specimen.configuration]]
name = "M1"
modes = "classes.csv"
"""
MODES = "mode,frequency_Hz,damping\n1,200,0.002\n2,150,\n"
SHAPES = "node,x,y,z,mode_1_real,mode_1_imag,mode_2_real,mode_2_imag\n1,0,0,1,1,0,4,0\n2,0,0,1,0.5,0,-2,0\n"


@pytest.fixture
def folder(tmp_path, stack_text):
    for name, text in (
        ("stack.toml", stack_text.replace("n_lamina = 240", "n_lamina = 20") + "[mesh]\nn_x = 4\nn_y = 2\n"),
        ("points.csv", "node,x,y,z\n1,0,0,30\n2,100,0,30\n"),
        ("modes.csv", MODES),
        ("shapes.csv", SHAPES),
        ("classes.csv", "shape_class,frequency_Hz\nbending 1,300\n"),
        ("campaign.toml", HEAD + FIRST + SECOND),
    ):
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def refused(folder, error, *, file="campaign.toml", **changed):
    """Change what a file holds, and return what is said."""
    path = folder / file
    text = path.read_text(encoding="utf-8")
    for old, new in changed["by"]:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(error) as raised:
        specimens_of(read_specimens(folder / "campaign.toml"), lambda name: None)
    return str(raised.value)


def test_a_specimen_has_values_of_its_own_and_those_of_the_rig(folder):
    campaign = read_specimens(folder / "campaign.toml")
    one, two = campaign.stacks
    assert (one.height, two.height) == pytest.approx((0.063, 0.065))
    assert (one.material.young, two.material.young) == pytest.approx((190e9, 200e9))
    assert one.material.density == two.material.density
    assert campaign.measured is None
    assert {path.name for path in campaign.inputs} == {
        "campaign.toml", "stack.toml", "modes.csv", "shapes.csv", "classes.csv",
    }  # fmt: skip


def test_modes_of_a_table_come_in_their_order_with_what_is_usual(folder):
    (folder / "campaign.toml").write_text(HEAD + FIRST + FIRST.replace('"S1"', '"S2"'), encoding="utf-8")
    first = specimens_of(read_specimens(folder / "campaign.toml"), lambda name: None)[0]
    assert first.notes == {"treatment": "glued"}
    name, pressure, modes = first.tested[0]
    assert (name, pressure) == ("M1", pytest.approx(160e3))
    np.testing.assert_allclose(modes.frequency, [150.0, 200.0])
    np.testing.assert_allclose(modes.frequency_std, [0.15, 0.2])
    np.testing.assert_allclose(modes.damping_std / modes.damping, [1e3, 0.1])  # the first was not measured
    np.testing.assert_allclose(modes.shape, [[1.0, 1.0], [-0.5, 0.5]])
    np.testing.assert_allclose(modes.shape_std[:, 1], 0.01 * np.sqrt(1.25 / 2.0))


def test_one_table_does_for_all_specimens(folder):
    whole = "specimen,configuration,shape_class,frequency_Hz\nS1,M1,bending 1,300\nS2,M1,bending 1,310\n"
    (folder / "classes.csv").write_text(whole, encoding="utf-8")
    text = HEAD + SECOND.replace('"S2"', '"S1"') + SECOND
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    specimens = specimens_of(read_specimens(folder / "campaign.toml"), lambda name: None)
    assert [one.tested[0][2].frequency.tolist() for one in specimens] == [[300.0], [310.0]]
    by = [("S2,M1", "S2,M2")]
    assert "classes.csv: no row of specimen 'S2', configuration 'M1'; the file has S1 M1, S2 M2" in refused(
        folder, MeasurementError, file="classes.csv", by=by
    )


def test_frfs_of_all_specimens_are_one_campaign(folder):
    (folder / "a.uff").write_bytes(b"")
    frf = FIRST.partition("modes =")[0] + 'files = ["a.uff"]\n'
    (folder / "campaign.toml").write_text(HEAD + frf + frf.replace('"S1"', '"S2"'), encoding="utf-8")
    measured = read_specimens(folder / "campaign.toml").measured
    assert [c.name for c in measured.configurations] == ["S1 M1", "S2 M1"]
    assert measured.configurations[0].pressure == pytest.approx(160e3)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("height_mm = 63", "heigth_mm = 63", "specimen[1].heigth_mm: unknown key; did you mean 'height_mm'"),
        ('modes = "classes.csv"', "", "configuration 'M1': give one source of its modes"),
        ('force = "1+z"', "", "'shapes' goes with 'modes' and with 'force'"),
        ('"S2"', '"S1"', "specimen: names must be unique, found S1, S1"),
        ("modes.csv", "mods.csv", "did you mean 'modes.csv'"),
        ("young_GPa = 190", "young_GPa = -1", "specimen[1].material.young_GPa"),
        (SECOND, "", "specimen: "),
    ],
)
def test_a_wrong_key_is_named(folder, old, new, said):
    message = refused(folder, FitError, by=[(old, new)])
    assert "campaign.toml" in message
    assert said in message


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        (
            "modes.csv",
            "frequency_Hz",
            "pitch",
            "modes.csv: no column 'frequency_hz'; the file has mode, pitch, damping",
        ),
        ("modes.csv", "200", "2oo", "modes.csv: row 2: frequency_hz is '2oo', expected a number"),
        ("modes.csv", "0.002", "1.2", "the damping ratio is 1.2, expected one above 0 and below 1"),
        ("shapes.csv", "mode_2_real", "x2", "shapes.csv: no column 'mode_2_real'"),
        ("shapes.csv", "\n2,", "\n7,", "points [7] are not in the list of points"),
        ("shapes.csv", "\n2,", "\n1e300,", "shapes.csv: row 3: node is '1e300', expected a whole number"),
        ("shapes.csv", "\n2,", "\n1.5,", "shapes.csv: row 3: node is '1.5', expected a whole number"),
        ("classes.csv", "shape_class", "class", "classes.csv: no column 'shape_class'"),
        ("classes.csv", "1,300", "1,300\nbending 1,310", "'bending 1' stands in more than one row"),
    ],
)
def test_a_wrong_table_is_named(folder, file, old, new, said):
    assert said in refused(folder, (FitError, MeasurementError), file=file, by=[(old, new)])


def test_levels_are_rig_groups_and_specimens():
    notes = [
        {"treatment": "glued", "maker": "A", "date": "1"},
        {"treatment": "glued", "maker": "A", "date": "2"},
        {"treatment": "none", "maker": "B", "date": "3"},
        {"treatment": "none", "maker": "B", "date": "4"},
    ]
    found = levels_of([Specimen(name=f"S{i}", stack=None, tested=(), notes=n) for i, n in enumerate(notes)])
    assert [(one.kind, one.of, one.members) for one in found] == [
        ("rig", "", (0, 1, 2, 3)),
        ("group", "treatment = glued", (0, 1)),
        ("group", "maker = B", (2, 3)),
        ("specimen", "S0", (0,)),
        ("specimen", "S1", (1,)),
        ("specimen", "S2", (2,)),
        ("specimen", "S3", (3,)),
    ]


@pytest.mark.parametrize("name", ["pooled_a", "pooled_b"])
def test_shipped_campaigns_are_small_and_read(name):
    folder = DATA / name
    assert sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) < 2e6
    assert has_specimens(folder / "campaign.toml")
    specimens = specimens_of(read_specimens(folder / "campaign.toml"), lambda name: None)
    assert len(specimens) == 6
    assert all(len(one.tested) == 2 for one in specimens)
    assert {one.notes["treatment"] for one in specimens} == {"none", "lacquered"}
    given = (folder / "campaign.toml").read_text(encoding="utf-8")
    assert not any(word in given for word in ("clamp_inertia", "clamp_mass", "adhesive", "exponent"))
