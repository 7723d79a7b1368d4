"""`lamella new`: what it finds in the files of a folder, and what it says that it cannot know."""

import re
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat
from typer.testing import CliRunner

from ema.campaign.campaign import read_campaign
from ema.campaign.draft import draft
from ema.campaign.draft_file import draft_file, write_draft
from ema.campaign.measurement import read_measurement
from ema.io.files import dof_name, dofs_in, unit_in
from ema.types.errors import CampaignError, EmaError
from updating.commands.command_line import app

DATA = Path(__file__).parents[2] / "data"
FREQUENCY = np.arange(10.0, 40.0)
rng = np.random.default_rng(0)
VALUE = rng.standard_normal((30, 3)) + 1j * rng.standard_normal((30, 3))
POINTS = "node,x,y,z\n" + "".join(f"{n},{100 * n},0,0\n" for n in (1, 2, 3, 45))


def new(folder, points=POINTS):
    """Write a list of points and run the command; return what it printed."""
    if points:
        (folder / "points.csv").write_text(points)
    done = CliRunner().invoke(app, ["new", str(folder)])
    assert done.exception is None, done.exception
    return done.output


def campaign_text(folder):
    return (folder / "campaign.toml").read_text(encoding="utf-8")


def fill(folder, *pairs):
    text = campaign_text(folder)
    for old, put in pairs:
        assert old in text
        text = text.replace(old, put)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")


def frf(folder, name):
    return read_measurement(read_campaign(folder / "campaign.toml"), name).frf


def columns(*parts, delimiter=",", decimal="."):
    rows = zip(FREQUENCY, *parts, strict=True)
    return "".join(delimiter.join(f"{x:.17g}".replace(".", decimal) for x in row) + "\n" for row in rows)


def real_imaginary(value=VALUE, **form):
    return columns(*(part for v in value.T for part in (v.real, v.imag)), **form)


@pytest.mark.parametrize(("shipped", "unknown"), [("demo_stack", ()), ("hidden_effect/b", (('"?"', '"(m/s2)/N"'),))])
def test_a_shipped_campaign_without_its_file(tmp_path, shipped, unknown):
    for name in ("M1", "M2", "points.csv"):
        source, copy = DATA / shipped / name, tmp_path / name
        shutil.copytree(source, copy) if source.is_dir() else shutil.copy(source, copy)
    new(tmp_path, points=None)
    if unknown:
        with pytest.raises(CampaignError, match=r"campaign\.toml: measurement\.unit: is to be filled in") as fault:
            read_campaign(tmp_path / "campaign.toml")
        assert len(str(fault.value).splitlines()) == 1
        fill(tmp_path, *unknown)
    campaign, there = (read_campaign(folder / "campaign.toml") for folder in (tmp_path, DATA / shipped))
    np.testing.assert_array_equal(campaign.geometry.coordinate, there.geometry.coordinate)
    assert [c.name for c in campaign.configurations] == [c.name for c in there.configurations]
    for name in ("M1", "M2"):
        found, right = read_measurement(campaign, name).frf, read_measurement(there, name).frf
        for what in ("frequency", "value", "coherence", "quantity", "run"):
            np.testing.assert_array_equal(getattr(found, what), getattr(right, what))
        for ends in ((found.output, right.output), (found.input, right.input)):
            np.testing.assert_array_equal(*(end.node for end in ends))
            np.testing.assert_array_equal(*(end.direction for end in ends))


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        ("f [Hz],1+z re,1+z im,2+z re,2+z im,3-x re,3-x im\n" + real_imaginary(), ["header_rows = 1"]),
        ("Test 3\n\nHz;1z Real;1z Imag;2z Real;2z Imag;3-x Real;3-x Imag\n"
         + real_imaginary(delimiter=";", decimal=","),
         ['delimiter = "semicolon"', 'decimal = ","', "header_rows = 3", "DOFs without a sign are taken as +"]),
        ("Prüfung\n" + "f\t1:+Z\t\t2:+Z\t\t3:-X\t\n" + real_imaginary(delimiter="\t"),
         ['delimiter = "tab"', 'encoding = "latin-1"', "taken as real and imaginary parts"]),
        ("f 1+z_mag 1+z_phase[rad] 2+z_mag 2+z_phase[rad] 3-x_mag 3-x_phase[rad]\n"
         + columns(*(p for v in VALUE.T for p in (np.abs(v), np.angle(v))), delimiter="  "),
         ['layout = "magnitude-phase"', 'delimiter = "space"', 'phase_unit = "rad"']),
        ("f,1+z dB,1+z phase,2+z dB,2+z phase,3-x dB,3-x phase\n"
         + columns(*(p for v in VALUE.T for p in (20 * np.log10(np.abs(v)), np.rad2deg(np.angle(v))))),
         ['magnitude_unit = "dB"']),
        ("f,1+z,2+z,3-x\n" + "".join(f"{f},{','.join(f'{v:.17g}' for v in row)}\n"
                                     for f, row in zip(FREQUENCY, VALUE, strict=True)), ['layout = "complex"']),
    ],
)  # fmt: skip
def test_layouts_of_tables(tmp_path, text, keys):
    (tmp_path / "M1").mkdir()
    (tmp_path / "M1/run.txt").write_text(text, encoding="latin-1")
    new(tmp_path)
    for key in keys:
        assert key in campaign_text(tmp_path)
    fill(tmp_path, ('unit = "?"', 'unit = "m/s2/N"'), ('input = ["?"]', 'input = ["45+z"]'))
    found = frf(tmp_path, "M1")
    np.testing.assert_allclose(found.value[:, 0], VALUE.T, rtol=1e-12)
    assert [found.output.name(k) for k in range(3)] == ["1+z", "2+z", "3-x"]


@pytest.mark.parametrize(
    ("titles", "kinds"),
    [
        (
            "Frequenz [Hz];1+z Realteil;1+z Imaginärteil;2+z Realteil;2+z Imaginärteil;3-x Realteil;3-x Imaginärteil",
            "ri",
        ),
        ("Frekvenca;1+z amplituda;1+z faza [deg];2+z amplituda;2+z faza [deg];3-x amplituda;3-x faza [deg]", "mp"),
        ("f;1+z Betrag;1+z Phase [°];2+z Betrag;2+z Phase [°];3-x Betrag;3-x Phase [°]", "mp"),
        ("f;1+z Re;2+z Re;3-x Re;1+z Im;2+z Im;3-x Im", "rrr"),
        ("f;1+z Re;1+z Im;f;2+z Re;2+z Im;f;3-x Re;3-x Im", "fri"),
    ],
)
def test_titles_of_other_languages_and_other_orders(tmp_path, titles, kinds):
    parts = {"r": lambda v: v.real, "i": lambda v: v.imag, "m": np.abs, "p": lambda v: np.rad2deg(np.angle(v))}
    if kinds == "rrr":
        one = [*VALUE.T.real, *VALUE.T.imag]
    elif kinds == "fri":
        one = [x for v in VALUE.T for x in (v.real, v.imag, FREQUENCY)][:-1]
    else:
        one = [parts[kind](v) for v in VALUE.T for kind in kinds]
    (tmp_path / "a.csv").write_text(titles + "\n" + columns(*one, delimiter=";", decimal=","), encoding="utf-8")
    new(tmp_path)
    fill(tmp_path, ('unit = "?"', 'unit = "m/s2/N"'), ('input = ["?"]', 'input = ["45+z"]'))
    found = frf(tmp_path, tmp_path.name)
    np.testing.assert_allclose(found.value[:, 0], VALUE.T, rtol=1e-12)
    assert [found.output.name(k) for k in range(3)] == ["1+z", "2+z", "3-x"]


@pytest.mark.parametrize(("title", "factor"), [("Frequency [kHz]", 1e-3), ("omega [rad/s]", 2 * np.pi)])
def test_frequencies_in_other_units(tmp_path, title, factor):
    rows = zip(factor * FREQUENCY, VALUE[:, 0].real, VALUE[:, 0].imag, strict=True)
    (tmp_path / "1z_45z.csv").write_text(
        f"{title},Re [g/N],Im [g/N]\n" + "".join(f"{a:.9g},{b:.9g},{c:.9g}\n" for a, b, c in rows)
    )
    new(tmp_path)
    assert "the frequencies are those of their column times" in campaign_text(tmp_path)
    found = frf(tmp_path, tmp_path.name)
    np.testing.assert_allclose(found.frequency, FREQUENCY, rtol=1e-8)
    np.testing.assert_allclose(found.value[0, 0], 9.80665 * VALUE[:, 0], rtol=1e-7)


def test_times_in_milliseconds(tmp_path):
    text = "Time (ms),Force (N),Acc (g)\n" + of_rows(1e3 * np.arange(600) / 2560, *pulse())
    (tmp_path / "a.csv").write_text(text)
    new(tmp_path)
    fill(tmp_path, ('# output = ["12+z"]', 'output = "1+z"\ninput = "45+z"'))
    assert frf(tmp_path, tmp_path.name).frequency[1] == pytest.approx(2560 / 600)


def test_magnitudes_alone_are_named_with_what_they_lack(tmp_path):
    (tmp_path / "a.csv").write_text("f [Hz],Magnitude [g/N]\n" + columns(np.abs(VALUE[:, 0])))
    with pytest.raises(CampaignError, match=r"a\.csv: 2 columns \(f \[Hz\], Magn.*magnitude and phase"):
        draft(tmp_path)


def test_dofs_and_unit_from_names_and_headers(tmp_path):
    for k, node in enumerate((1, 2, 3)):
        text = "f [Hz],Re [g/N],Im [g/N]\n" + real_imaginary(VALUE[:, [k]])
        (tmp_path / f"frf_{node}z_45-z.csv").write_text(text)
    new(tmp_path)
    assert "# guessed: DOFs are taken from the file names, the response first, without a sign as +" in campaign_text(
        tmp_path
    )
    found = frf(tmp_path, tmp_path.name)
    np.testing.assert_allclose(found.value[:, 0], 9.80665 * VALUE.T, rtol=1e-12)
    assert [found.output.name(k) for k in range(3)] == ["1+z", "2+z", "3+z"]
    assert found.input.name(0) == "45-z"


@pytest.mark.parametrize("kind", ["mat", "h5"])
def test_files_of_arrays(tmp_path, kind):
    content = {"FRF": VALUE, "freq": FREQUENCY, "coh": np.abs(VALUE) / 10, "out_node": [1, 2, 3], "out_dir": [3, 3, -1],
               "ref_node": [45], "ref_dir": [3]}  # fmt: skip
    (tmp_path / "M1").mkdir()
    if kind == "mat":
        savemat(tmp_path / "M1/run.mat", content)
    else:
        with h5py.File(tmp_path / "M1/run.h5", "w") as file:
            for name, value in content.items():
                file[name] = value
    new(tmp_path)
    assert 'axes = ["frequency", "output"]' in campaign_text(tmp_path)
    with pytest.raises(CampaignError, match=r"measurement\.unit: is to be filled in"):
        read_campaign(tmp_path / "campaign.toml")
    fill(tmp_path, ('unit = "?"', 'unit = "m/s2/N"'))
    found = frf(tmp_path, "M1")
    np.testing.assert_array_equal(found.value[:, 0], VALUE.T)
    np.testing.assert_array_equal(found.coherence[:, 0], np.abs(VALUE.T) / 10)
    assert [found.output.name(k) for k in range(3)] == ["1+z", "2+z", "3-x"]
    assert found.input.name(0) == "45+z"


@pytest.mark.parametrize(
    ("content", "right", "step"),
    [
        ({"FRF": {"x_values": {"start_value": 10.0, "increment": 1.0}, "y_values": {"values": VALUE}}}, 10.0, 1.0),
        ({f"Signal_{k}": {"x_values": {"start_value": 0.0, "increment": 2.0, "number_of_values": 30},
                          "y_values": {"values": VALUE[:, [k]]}} for k in range(3)}, 0.0, 2.0),
        ({"H": VALUE, "fs": 580.0}, 0.0, 10.0),
        ({"H": VALUE, "df": 0.5}, 0.0, 0.5),
    ],
)  # fmt: skip
def test_frequencies_that_are_numbers(tmp_path, content, right, step):
    """As Test.Lab exports them, and scripts that keep a step or a sampling rate."""
    savemat(tmp_path / "a.mat", content)
    new(tmp_path)
    fill(tmp_path, ('unit = "?"', 'unit = "m/s2/N"'), ('output = ["?"]', 'output = ["1+z", "2+z", "3+z"]'),
         ('input = ["?"]', 'input = ["45+z"]'))  # fmt: skip
    found = frf(tmp_path, tmp_path.name)
    np.testing.assert_allclose(found.frequency, right + step * np.arange(30))
    np.testing.assert_allclose(found.value[:, 0], VALUE.T)


def test_points_of_output_and_input_are_told_apart(tmp_path):
    names = {"FRF": VALUE[:, :1], "f": FREQUENCY, "outNode": 2, "outDir": -1, "refNode": 45, "refDir": 3}
    savemat(tmp_path / "run.mat", names)
    new(tmp_path)
    fill(tmp_path, ('unit = "?"', 'unit = "m/s2/N"'))
    found = frf(tmp_path, tmp_path.name)
    assert (found.output.name(0), found.input.name(0)) == ("2-x", "45+z")


@pytest.mark.parametrize(
    ("content", "key"),
    [
        ({"re": VALUE.real, "im": VALUE.imag, "f": FREQUENCY}, r"configuration\[1\]\.output\[1\]: is to be filled in"),
        ({"H": VALUE}, r"measurement\.variables\.frequency: is to be filled in"),
        ({"Cross_Spec": VALUE, "f": FREQUENCY}, r"measurement\.variables\.frf: is to be filled in"),
    ],
)
def test_what_arrays_do_not_tell_is_asked_for(tmp_path, content, key):
    savemat(tmp_path / "run.mat", content)
    said = new(tmp_path)
    assert "to be filled in" in campaign_text(tmp_path)
    assert "output of configuration" in said
    fill(tmp_path, ('unit = "?"', 'unit = "m/s2/N"'))
    if "variable" in key:
        text = re.sub(r'(output|input) = \["\?"\]', r'\1 = ["1+z"]', campaign_text(tmp_path))
        (tmp_path / "campaign.toml").write_text(text)
    with pytest.raises(EmaError, match=key):
        frf(tmp_path, tmp_path.name)


def test_what_nobody_can_know_is_printed_and_asked_for(tmp_path):
    (tmp_path / "M1_run03.csv").write_text(real_imaginary(VALUE[:, [0]]))
    said = new(tmp_path, points=None)
    for key in ("points.file", "structure.stack", "measurement.unit", "torque_Nm or pressure_kPa", "input of conf"):
        assert key in said
    with pytest.raises(CampaignError) as fault:
        read_campaign(tmp_path / "campaign.toml")
    said = [line.partition("campaign.toml: ")[2] for line in str(fault.value).splitlines()]
    keys = {line.partition(":")[0] for line in said}
    assert keys == {"measurement.unit", "configuration[1].output[1]", "configuration[1].input[1]"}


def test_time_histories(tmp_path):
    time = np.arange(100) / 1000
    rows = "".join(f"{t:.4f},{np.sin(99 * t):.6f},{np.cos(70 * t):.6f}\n" for t in time)
    (tmp_path / "blow_1.csv").write_text("time [s],force,acceleration\n" + rows)
    new(tmp_path)
    with pytest.raises(CampaignError) as fault:
        read_campaign(tmp_path / "campaign.toml")
    assert "measurement.time.window" in str(fault.value)
    pairs = [("window", "boxcar"), ("force_unit", "N"), ("response_unit", "m/s2")]
    fill(tmp_path, *((f'{key} = "?"', f'{key} = "{put}"') for key, put in pairs))
    with pytest.raises(EmaError, match="does not state the output DOF"):
        frf(tmp_path, tmp_path.name)
    fill(tmp_path, ("[[configuration]]", '[[configuration]]\noutput = ["1+z"]\ninput = ["45+z"]'))
    assert frf(tmp_path, tmp_path.name).quantity == "accelerance"


def test_time_histories_without_a_title(tmp_path):
    time = np.arange(100) / 51200
    rows = "".join(f"{t:.6e}\t{np.sin(99 * t):.6e}\t{np.cos(70 * t):.6e}\n" for t in time)
    (tmp_path / "Point1_Channel1.txt").write_text(rows)
    new(tmp_path)
    text = campaign_text(tmp_path)
    assert 'layout = "time"' in text
    assert "the first column is taken as the time in s, since a step of 1.953e-05 Hz is none of a frequency" in text


def test_the_sampling_rate_of_a_header_tells_histories_of_slow_structures(tmp_path):
    time = np.arange(100) / 50
    rows = "".join(f"{t:.2f},{np.sin(9 * t):.6f},{np.cos(7 * t):.6f}\n" for t in time)
    (tmp_path / "a.csv").write_text(f'"Sampling Rate(Hz)",50\n"CH No.","CH2","CH3"\n{rows}')
    new(tmp_path)
    text = campaign_text(tmp_path)
    assert 'layout = "time"' in text
    assert "the header tells of sampling" in text


def analyser_text(value, unit="(m/s²)/N"):
    """An analyser's export: words above, rows that are counted, and words below."""
    rows = [
        f"{k}\t {f:.6e}\t {v.real:.6e}\t{v.imag:.6e}" for k, (f, v) in enumerate(zip(FREQUENCY, value, strict=True), 1)
    ]
    head = ["Function:\tFrequency Response", f"AmplitudeUnit:\t{unit}", "X-Axis unit:\tHz", "Z-index:\t1"]
    return "\r\n".join([*head, *rows, "TagsBegin:\t \t", "Title\tA 1", "TagsEnd:\t"]) + "\r\n"


def test_an_analysers_text_with_counted_rows_and_words_below_them(tmp_path):
    for k in range(3):
        (tmp_path / f"{k + 1}z_45z.txt").write_bytes(analyser_text(VALUE[:, k]).encode("latin-1"))
    new(tmp_path)
    text = campaign_text(tmp_path)
    assert "axis_column = 2" in text
    assert 'unit = "(m/s²)/N"' in text
    found = frf(tmp_path, tmp_path.name)
    np.testing.assert_allclose(found.frequency, FREQUENCY)
    np.testing.assert_allclose(found.value[:, 0], VALUE.T, rtol=1e-6)


def test_frfs_beside_spectra(tmp_path):
    """As an analyser writes them: frequencies in the first column of everything, each function a variable."""
    (tmp_path / "M1").mkdir()
    content = {"S1": VALUE[:, 0], "G1_2": VALUE[:, 1], "S1_2": VALUE[:, 2]}
    content |= {f"H1_{k + 2}": VALUE[:, k] for k in range(3)} | {
        f"C1_{k + 2}": np.abs(VALUE[:, k]) / 10 for k in range(3)
    }
    savemat(tmp_path / "M1/run.mat", {n: np.column_stack([FREQUENCY, v]) for n, v in content.items()})
    new(tmp_path)
    text = campaign_text(tmp_path)
    assert "variables 'H1_2', 'H1_3', 'H1_4' are taken as the FRFs; other complex variables are 'S1'" in text
    assert "the first column of the FRFs is taken as their frequencies" in text
    fill(tmp_path, ('unit = "?"', 'unit = "m/s2/N"'), ('input = ["?"]', 'input = ["45+z"]'),
         ('output = ["?"]', 'output = ["1+z", "2+z", "3+z"]'))  # fmt: skip
    measured = read_measurement(read_campaign(tmp_path / "campaign.toml"), "M1")
    np.testing.assert_array_equal(measured.frf.frequency, FREQUENCY)
    np.testing.assert_array_equal(measured.frf.value[:, 0], VALUE.T)
    np.testing.assert_array_equal(measured.frf.coherence[:, 0], np.abs(VALUE.T) / 10)


def test_no_spectrum_is_a_coherence_or_an_frf(tmp_path):
    spectrum = {"Cross_Spec": VALUE[:, 0], "Mag_Spec": np.abs(VALUE[:, 0]) / 10, "Freq": FREQUENCY}
    (tmp_path / "one").mkdir()
    savemat(tmp_path / "one/run.mat", spectrum | {"Hf_2": VALUE[:, 1], "Hf_coh_2": np.abs(VALUE[:, 1]) / 2})
    new(tmp_path)
    assert 'frf = "Hf_2"' in campaign_text(tmp_path)
    assert 'coherence = "Hf_coh_2"' in campaign_text(tmp_path)
    other = tmp_path / "two"
    other.mkdir()
    savemat(other / "run.mat", spectrum)
    new(other)
    assert 'frf = "?"' in campaign_text(other)
    assert "'Cross_Spec' look like spectra" in campaign_text(other)


def test_a_first_line_beside_zero_is_that_of_zero(tmp_path):
    """As some files write it, so that one may divide by the frequency."""
    frequency = np.concatenate([[1e-5], np.arange(1, 30) * 1e-3])
    savemat(tmp_path / "run.mat", {"FRF": VALUE, "freq": frequency})
    new(tmp_path)
    fill(tmp_path, ('unit = "?"', 'unit = "m/s2/N"'), ('input = ["?"]', 'input = ["45+z"]'),
         ('output = ["?"]', 'output = ["1+z", "2+z", "3+z"]'))  # fmt: skip
    np.testing.assert_allclose(frf(tmp_path, tmp_path.name).frequency, np.arange(30) * 1e-3)


def test_a_circular_frequency_is_not_taken_for_one_in_hertz(tmp_path):
    savemat(tmp_path / "run.mat", {"FRF": VALUE, "w": 2 * np.pi * FREQUENCY})
    new(tmp_path)
    assert "# guessed: the frequencies are variable 'w', in rad/s, over 2 pi" in campaign_text(tmp_path)
    ends = ('output = ["?"]', 'output = ["1+z", "2+z", "3+z"]'), ('input = ["?"]', 'input = ["1+z"]')
    fill(tmp_path, ('unit = "?"', 'unit = "m/s2/N"'), *ends)
    np.testing.assert_allclose(frf(tmp_path, tmp_path.name).frequency, FREQUENCY, rtol=1e-9)


def test_points_of_a_universal_file(tmp_path):
    (tmp_path / "M1").mkdir()
    shutil.copy(DATA / "demo_stack/M1/run_01.uff", tmp_path / "M1")
    new(tmp_path, points=None)
    assert 'file = "M1/run_01.uff"' in campaign_text(tmp_path)
    assert read_campaign(tmp_path / "campaign.toml").geometry.node.size == 45


def test_measured_points_that_are_not_listed(tmp_path):
    for node in (1, 7):
        (tmp_path / f"{node}z_45z.csv").write_text("f,Re [g/N],Im [g/N]\n" + real_imaginary(VALUE[:, [0]]))
    assert "points [7]: measured, but not in points.csv" in new(tmp_path)
    with pytest.raises(EmaError, match=r"7z_45z\.csv: column 2, 3: point 7 of the response is not in"):
        frf(tmp_path, tmp_path.name)
    fill(tmp_path, ("# without_coordinates", "without_coordinates"))
    np.testing.assert_array_equal(frf(tmp_path, tmp_path.name).output.node, [1, 7])


def test_time_histories_beside_frfs_are_left_out(tmp_path):
    (tmp_path / "1z_45z.csv").write_text("f,Re [g/N],Im [g/N]\n" + real_imaginary(VALUE[:, [0]]))
    for k in range(2):
        (tmp_path / f"time_{k}.csv").write_text("time [s],force,acceleration\n" + columns(FREQUENCY, FREQUENCY))
    assert len(re.findall(r"left out: .*time_.\.csv: holds time histories", new(tmp_path))) == 2
    assert frf(tmp_path, tmp_path.name).output.name(0) == "1+z"


def test_columns_that_might_be_frfs_beside_many_time_histories(tmp_path):
    (tmp_path / "notes.csv").write_text(columns(VALUE[:, 0].real, VALUE[:, 0].imag))
    for k in range(2):
        (tmp_path / f"time_{k}.csv").write_text("time [s],force,acceleration\n" + columns(FREQUENCY, FREQUENCY))
    assert re.search(r"left out: .*notes\.csv: its columns might be FRFs", new(tmp_path))
    assert 'files = ["time_*.csv"]' in campaign_text(tmp_path)


def test_two_forces_of_one_name_are_not_paired(tmp_path):
    for name in ("force_a", "hammer_a", "acc_a"):
        (tmp_path / f"{name}.csv").write_text(of_rows(np.arange(600) / 2560, pulse()[0]))
    new(tmp_path)
    assert 'files = ["*_a.csv"]' in campaign_text(tmp_path)


def test_a_campaign_file_is_not_overwritten(tmp_path):
    (tmp_path / "a.csv").write_text(real_imaginary())
    (tmp_path / "campaign.toml").write_text("mine")
    with pytest.raises(CampaignError, match=r"campaign\.toml: is there already and is not overwritten"):
        write_draft(found := draft(tmp_path), draft_file(found))
    assert campaign_text(tmp_path) == "mine"


@pytest.mark.parametrize(("name", "said"), [("none", "is not a folder"), (".", "no file in it looks like a meas")])
def test_a_folder_without_measurements(tmp_path, name, said):
    (tmp_path / "points.csv").write_text(POINTS)
    (tmp_path / "curve.csv").write_text("strain,pressure\n" + "".join(f"{k},{k * k}\n" for k in range(20)))
    with pytest.raises(CampaignError, match=said):
        draft(tmp_path / name)


def test_histories_without_a_time_are_named_with_the_way_out(tmp_path):
    rows = "".join(f"{np.sin(k):.3f},{np.cos(k):.3f}\n" for k in range(20))
    for k in (1, 2, 10):
        (tmp_path / f"blow_{k}.csv").write_text("left,right\n" + rows)
    with pytest.raises(CampaignError, match=r"blow_1\.csv and 2 more: 2 columns \(left, right.*axis_column = 0"):
        draft(tmp_path)


def pulse(n=600, at=20):
    """The force of a blow, and a response that rings."""
    force, k = np.zeros(n), np.arange(n)
    force[at : at + 3] = 20.0, 50.0, 30.0
    return force, np.convolve(force, np.exp(-0.02 * k) * np.sin(0.4 * k))[:n]


def of_rows(*parts, form="{:.5f}"):
    return "".join(",".join(map(form.format, row)) + "\n" for row in zip(*parts, strict=True))


@pytest.mark.parametrize(
    ("head", "keys"),
    [
        ("acceleration [g],force [N]\n", ['sampling_Hz = "?"', "axis_column = 0", 'response_unit = "g"']),
        ("Sampling Rate: 2.56 kHz\nCH1,CH2\ncm/s2,N\n", ["sampling_Hz = 2560.0", "rate is that of the header"]),
    ],
)  # fmt: skip
def test_histories_without_a_time_whose_titles_or_header_tell(tmp_path, head, keys):
    (tmp_path / "blow.csv").write_text(head + of_rows(*pulse()[::-1]))
    new(tmp_path)
    for key in (*keys, "force = 2", 'window = "boxcar"  # guessed', 'force_unit = "N"  # as the header says'):
        assert key in campaign_text(tmp_path)


@pytest.mark.parametrize("kind", ["mat", "npz", "h5"])
def test_histories_of_arrays(tmp_path, kind):
    """Three blows of each of four points: axes, rate and force are guessed, and the blows averaged."""
    value = np.array([[pulse(600, 20 + 5 * k + p) for k in range(3)] for p in range(4)])
    content = {"acc": value[:, :, 1], "hammer": value[:, :, 0], "fs": 2560.0}
    if kind == "mat":
        savemat(tmp_path / "a.mat", content)
    elif kind == "npz":
        np.savez(tmp_path / "a.npz", **content)
    else:
        with h5py.File(tmp_path / "a.h5", "w") as file:
            for name, one in content.items():
                file[f"data/{name}"] = one
    new(tmp_path)
    in_group = "data/" if kind == "h5" else ""
    for key in (
        f'history = ["{in_group}hammer", "{in_group}acc"]', 'axes = ["run", "hit", "time"]', 'window = "boxcar"',
        f'sampling_Hz = "{in_group}fs"', "force = 1  # guessed: its title says so",
    ):  # fmt: skip
        assert key in campaign_text(tmp_path)
    fill(tmp_path, ('force_unit = "?"', 'force_unit = "N"'), ('response_unit = "?"', 'response_unit = "g"'),
         ('# output = ["12+z"]', 'output = "45+z"\ninput = ["1+z", "2+z", "3+z", "45+z"]'))  # fmt: skip
    found = frf(tmp_path, tmp_path.name)
    assert found.output.node.tolist() == [1, 2, 3, 45]
    assert found.coherence is not None
    assert 2560 * 0.4 / (2 * np.pi) == pytest.approx(found.frequency[np.abs(found.value[0, 0, :200]).argmax()], abs=5)


def test_the_force_of_arrays_without_names_is_the_channel_with_a_pulse(tmp_path):
    """Three blows, two channels, with neither times nor rate: what `numpy.save` leaves."""
    np.save(tmp_path / "a.npy", np.array([pulse(600, 20 + k)[::-1] for k in range(3)]))
    new(tmp_path)
    for key in ('axes = ["hit", "channel", "time"]', 'sampling_Hz = "?"', "force = 2  # guessed: it is a short pulse"):
        assert key in campaign_text(tmp_path)


@pytest.mark.parametrize("kind", ["mat", "h5"])
def test_structures_and_groups_are_hits(tmp_path, kind):
    if kind == "mat":
        rows = np.empty(3, dtype=[("force", object), ("acc", object)])
        for k in range(3):
            rows[k] = pulse(600 + 9 * k, 20)
        savemat(tmp_path / "a.mat", {"data": rows, "dt": 1 / 2560})
        names = '["data(*).force", "data(*).acc"]'
    else:
        with h5py.File(tmp_path / "a.h5", "w") as file:
            for k in range(3):
                file[f"blow{k}/hammer"], file[f"blow{k}/x"] = pulse(600, 20 + k)
                file[f"blow{k}/time"] = np.arange(600) / 2560
        names = '["blow*/hammer", "blow*/x"]'
    new(tmp_path)
    assert f"history = {names}" in campaign_text(tmp_path)
    assert 'axes = ["hit", "time"]' in campaign_text(tmp_path)
    fill(tmp_path, ('force_unit = "?"', 'force_unit = "N"'), ('response_unit = "?"', 'response_unit = "g"'),
         ('# output = ["12+z"]', 'output = "1+z"\ninput = "45+z"'))  # fmt: skip
    found = frf(tmp_path, tmp_path.name)
    assert found.coherence is not None
    assert 2560 * 0.4 / (2 * np.pi) == pytest.approx(found.frequency[np.abs(found.value[0, 0, :200]).argmax()], abs=5)


def test_groups_of_points_are_runs(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for point in (1, 2, 3):
            for k in range(2):
                file[f"point_{point}/hit_{k}/force"], file[f"point_{point}/hit_{k}/acc"] = pulse(600, 20 + k)
                file[f"point_{point}/hit_{k}"].attrs["fs"] = 2560
    new(tmp_path)
    assert 'sampling_Hz = "point_*/hit_*@fs"' in campaign_text(tmp_path)
    assert "for each of 3 functions" in campaign_text(tmp_path)
    assert 'history = ["point_*/hit_*/force", "point_*/hit_*/acc"]' in campaign_text(tmp_path)
    assert 'axes = ["run", "hit", "time"]' in campaign_text(tmp_path)
    assert "'point_*' and 'hit_*' in the names is taken as run, hit" in campaign_text(tmp_path)


def test_a_roving_test_in_groups_is_read_as_drafted(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["fs"] = 2560.0
        for point in (1, 2):
            file[f"p{point}/force"], file[f"p{point}/acc"] = np.array([pulse(600, 20 + k) for k in range(3)]).swapaxes(
                0, 1
            )
    new(tmp_path)
    assert 'axes = ["run", "hit", "time"]' in campaign_text(tmp_path)
    assert 'sampling_Hz = "@fs"' in campaign_text(tmp_path)
    fill(tmp_path, ('force_unit = "?"', 'force_unit = "N"'), ('response_unit = "?"', 'response_unit = "g"'),
         ('# output = ["12+z"]', 'output = ["1+z", "2+z"]'), ('# input = ["12+z"]', 'input = "45+z"'))  # fmt: skip
    found = frf(tmp_path, tmp_path.name)
    assert found.run.tolist() == [0, 1]
    assert found.frequency[1] == pytest.approx(2560 / 600)


def test_a_time_step_and_times_in_the_first_channel(tmp_path):
    (tmp_path / "a").mkdir()
    savemat(tmp_path / "a/a.mat", {"x": pulse()[1], "f": pulse()[0], "dt": 1 / 2560})
    new(tmp_path)
    text = campaign_text(tmp_path)
    assert 'history = ["f", "x"]' in text
    assert "sampling_Hz = 2560.0" in text
    (tmp_path / "campaign.toml").unlink()
    savemat(tmp_path / "a/a.mat", {"Data": np.column_stack([np.arange(600) / 2560, *pulse()])})
    new(tmp_path)
    assert 'time = "first channel"' in campaign_text(tmp_path)
    assert 'axes = ["time", "channel"]' in campaign_text(tmp_path)


def test_arrays_that_no_time_and_no_hammer_tells_of_are_no_histories(tmp_path):
    savemat(tmp_path / "a.mat", {"shapes": np.cos(np.outer(np.arange(900), [0.01, 0.02])), "x": np.eye(700)[:, :2] > 0})
    done = CliRunner().invoke(app, ["new", str(tmp_path)])
    assert isinstance(done.exception, CampaignError)
    assert "a.mat: no array in it is complex" in str(done.exception)
    savemat(tmp_path / "frf.mat", {"H": VALUE, "f": FREQUENCY})
    assert "left out: " in (said := new(tmp_path))
    assert "a.mat: no array in it is complex" in said
    assert 'files = ["frf.mat"]' in campaign_text(tmp_path)


@pytest.mark.parametrize(
    ("names", "files"),
    [
        (("hit{}_force", "hit{}_acc"), '[["hit*_force.csv", "hit*_acc.csv"]]'),
        (("impact_pt{}", "accel-pt{}"), '[["impact_pt*.csv", "accel-pt*.csv"]]'),
        (("F{}", "A{}"), '[["F*.csv", "A*.csv"]]'),
        (("hit{}_Kraft", "hit{}_acc1", "hit{}_acc2"), '[["hit*_Kraft.csv", "hit*_acc1.csv", "hit*_acc2.csv"]]'),
    ],
)
def test_force_and_responses_in_files_of_their_own(tmp_path, names, files):
    time = np.arange(600) / 2560
    for k in (1, 2, 10):
        force, response = pulse(600, 20 + k)
        for name, value in zip(names, (force, response, -response), strict=False):
            (tmp_path / f"{name.format(k)}.csv").write_text(of_rows(time, value))
    new(tmp_path)
    text = campaign_text(tmp_path)
    assert f"files = {files}" in text
    assert ("[[configuration.run]]\nfiles" in text) == ("hit" in names[0])
    fill(tmp_path, ('force_unit = "?"', 'force_unit = "N"'), ('response_unit = "?"', 'response_unit = "g"'),
         ('# output = ["12+z"]', f'output = {["1+z", "2+z"][: len(names) - 1]}\ninput = "45+z"'))  # fmt: skip
    found = frf(tmp_path, tmp_path.name)
    assert found.value.shape[0] == len(names) - 1
    assert len(set(found.run)) == 1


@pytest.mark.parametrize("n", [1, 2])
def test_force_and_responses_in_arrays_of_their_own(tmp_path, n):
    """Three blows in each file; the force has no axis of channels."""
    for k in (1, 2):
        force, response = np.array([pulse(600, 20 + k + hit) for hit in range(3)]).swapaxes(0, 1)
        np.save(tmp_path / f"force_{k}.npy", force)
        np.save(tmp_path / f"response_{k}.npy", np.stack([response, -response], axis=1) if n == 2 else response)
    new(tmp_path)
    assert 'files = [["force_*.npy", "response_*.npy"]]' in campaign_text(tmp_path)
    fill(tmp_path, ('sampling_Hz = "?"', "sampling_Hz = 2560"), ('force_unit = "?"', 'force_unit = "N"'),
         ('response_unit = "?"', 'response_unit = "g"'), ('# input = ["12+z"]', 'input = "45+z"'),
         ('# output = ["12+z"]', f'output = {["1+z", "2+z"][:n] * 2}'))  # fmt: skip
    found = frf(tmp_path, tmp_path.name)
    assert found.value.shape[0] == n
    assert found.coherence is not None


def test_dofs_of_histories_from_titles_and_names(tmp_path):
    time = np.arange(600) / 2560
    for point in (1, 2):
        for k in (1, 2):
            force, response = pulse(600, 20 + k)
            rows = of_rows(time, response, force)
            (tmp_path / f"P{point}_Z_blow{k}.csv").write_text("Zeit [s],45+z Beschleunigung [m/s²],Kraft [N]\n" + rows)
    new(tmp_path)
    text = campaign_text(tmp_path)
    assert text.count("[[configuration.run]]") == 2
    assert 'response_unit = "m/s²"' in text
    found = frf(tmp_path, tmp_path.name)
    assert found.output.node.tolist() == [1, 2]  # given by reciprocity
    assert found.input.name(0) == "45+z"
    assert found.coherence is not None


def test_titles_of_numpy_follow_a_sign_of_a_comment(tmp_path):
    table = np.column_stack([np.arange(600) / 2560, *pulse()[::-1]])
    np.savetxt(tmp_path / "P2_Z_hit1.txt", table, header="Time[s] 1+z[g] Force[N]")
    new(tmp_path)
    text = campaign_text(tmp_path)
    for key in ("force = 2  # guessed: its title", 'force_unit = "N"', 'response_unit = "g"', 'output = ["1+z"]'):
        assert key in text
    assert 'input = ["2+z"]' in text


def test_what_titles_tell_of_outputs_is_written_where_the_force_is_not_told(tmp_path):
    table = of_rows(np.arange(600) / 2560, *pulse())
    (tmp_path / "a.csv").write_text("Time [s],Force [N],1+z [g]\n" + table)
    said = new(tmp_path)
    assert 'output = ["1+z"]' in campaign_text(tmp_path)
    assert '# input = ["12+z"]  # to be filled in: one for all, or one for each of 1 functions' in campaign_text(
        tmp_path
    )
    assert re.search(r"^ *input of configuration", said, re.MULTILINE)


def test_frequencies_of_the_structural_dynamics_toolbox(tmp_path):
    savemat(tmp_path / "a.mat", {"XF": {"w": FREQUENCY, "xf": VALUE, "dof": [[1.03, 45.03]]}})
    new(tmp_path)
    assert 'frequency = "XF.w"' in campaign_text(tmp_path)


def test_blocks_are_guessed_where_a_record_holds_many_hits(tmp_path):
    force, response = (np.concatenate([one, one, 0.5 * one, one]) for one in pulse())
    (tmp_path / "a.csv").write_text("time [s],force,acc\n" + of_rows(np.arange(force.size) / 600, force, response))
    new(tmp_path)
    for key in ("block_s = 0.9  #", "before_hit_s = 0.018  #"):
        assert key in campaign_text(tmp_path)


def labview(x_columns, decimal="."):
    """What LabVIEW writes of a force and an acceleration: a header, one of the channels, titles, rows, comments."""
    time, (force, response) = np.arange(600) * 4e-4, pulse()
    step, start = "\t".join(["4.000000E-4"] * 2), "\t".join(["0.0000000000000000E+0"] * 2)
    head = [
        "LabVIEW Measurement\t", f"Decimal_Separator\t{decimal}", f"X_Columns\t{x_columns}", "Date\t2024/01/31",
        "***End_of_Header***\t", "\t", "Channels\t2\t\t", "Samples\t600\t600\t", "Date\t2024/01/31\t2024/01/31\t",
        "Y_Unit_Label\tN\tg\t", "X_Dimension\tTime\tTime\t", f"X0\t{start}\t", f"Delta_X\t{step}\t",
        "***End_of_Header***\t\t\t",
    ]  # fmt: skip
    columns = {"One": [time, force, response], "Multi": [time, force, time, response], "No": [force, response]}[
        x_columns
    ]
    titles = {
        "One": "X_Value\tHammer\tDiskrete",
        "Multi": "X_Value\tHammer\tX_Value\tDiskrete",
        "No": "X_Value\tHammer\tDiskrete",
    }
    lead = "\t" if x_columns == "No" else ""
    rows = [lead + "\t".join(f"{x:.6f}" for x in row) for row in zip(*columns, strict=True)]
    text = "\n".join([*head, titles[x_columns] + "\tComment", *rows]) + "\n"
    return text.replace(".", ",") if decimal == "," else text


@pytest.mark.parametrize("x_columns", ["One", "Multi", "No"])
@pytest.mark.parametrize("decimal", [".", ","])
def test_text_of_labview(tmp_path, x_columns, decimal):
    (tmp_path / "blow.lvm").write_text(labview(x_columns, decimal))
    new(tmp_path)
    for key in (
        "force = 1  # guessed: its title says so",
        'window = "boxcar"',
        'force_unit = "N"',
        'response_unit = "g"',
    ):
        assert key in campaign_text(tmp_path)
    fill(tmp_path, ('# output = ["12+z"]', 'output = "1+z"\ninput = "45+z"'))
    found = frf(tmp_path, tmp_path.name)
    assert found.frequency[1] == pytest.approx(1 / (600 * 4e-4))
    assert found.output.node.size == 1


def test_rounded_times_are_given_their_rate(tmp_path):
    (tmp_path / "a.csv").write_text(of_rows(np.arange(600) / 2560, *pulse(), form="{:.3f}"))
    new(tmp_path)
    assert "sampling_Hz = 2560.0" in campaign_text(tmp_path)
    assert "the times are rounded: the first 600 samples in 0.234 s give the sampling rate" in campaign_text(tmp_path)


def test_files_that_are_left_out_are_named(tmp_path):
    for k in range(3):
        (tmp_path / f"{k + 1}z_45z.csv").write_text(real_imaginary(VALUE[:, [k]]))
    (tmp_path / "odd.csv").write_text(real_imaginary(VALUE[:, [0]]).replace(",", ";"))
    (tmp_path / "broken.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(300))
    said = new(tmp_path)
    assert re.search(r"left out: .*odd\.csv: laid out otherwise .*\(delimiter semicolon instead of none", said)
    assert re.search(r"left out: .*broken\.mat: cannot be read", said)
    assert 'files = ["*z_45z.csv"]' in campaign_text(tmp_path)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("frf_12z_45z.csv", ["12+z", "45+z"]),
        ("beam:12:+Z", ["12+z"]),
        ("H 12-x/45Y-", ["12-x", "45-y"]),
        ("M1_run03.uff", []),
        ("run_0z 3.5x 4xy", []),
        ("P12_Z.txt", ["12+z"]),
        ("Point 3 -x, Punkt 4:y+ Pt5", ["3-x", "4+y"]),
    ],
)
def test_dofs_in_a_text(text, names):
    assert [dof_name(code) for code in dofs_in(text)] == names


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("f [Hz] FRF [g/N]", "g/N"),
        ("(m/s2)/N re", "(m/s2)/N"),
        ("Re (mm/N)", "(mm/N)"),
        ("H1: Betrag/(m/s²/N)", "m/s²/N"),
        ("H1: Betrag[(m/s^2)/N]", "(m/s^2)/N"),
        ("Hz m/s2 N re/im", None),
    ],
)
def test_a_unit_in_a_header(text, unit):
    assert unit_in(text) == unit


def test_files_that_are_not_read_are_named_with_a_way_out(tmp_path):
    (tmp_path / "hammer.xlsx").write_bytes(b"PK")
    with pytest.raises(CampaignError, match=r"hammer\.xlsx: is a workbook: save its sheet as CSV"):
        draft(tmp_path)


def test_a_file_of_labview_is_looked_into(tmp_path):
    force, response = pulse()
    with TdmsWriter(tmp_path / "1z.tdms") as writer:
        writer.write_segment(
            [
                ChannelObject(f"hit {k}", name, value, {"wf_increment": 1.0 / 2560, "unit_string": unit})
                for k in range(3)
                for name, value, unit in (("cDAQ1/ai0", force, "N"), ("cDAQ1/ai1", response, "g"))
            ]
        )
    new(tmp_path)
    text = campaign_text(tmp_path)
    assert 'history = ["hit */cDAQ1/ai0", "hit */cDAQ1/ai1"]' in text
    assert 'axes = ["hit", "time"]' in text
    assert "sampling_Hz = 2560" in text
    assert "force = 1" in text
    assert 'force_unit = "N"' in text
    assert 'response_unit = "g"' in text


@pytest.mark.parametrize(("name", "outputs"), [("point_{}", '["1+z", "2+z", "3+z"]'), ("frf_{}", '["?"]')])
def test_a_point_without_a_direction_in_a_file_name_is_a_guess_that_is_told(tmp_path, name, outputs):
    for node in (1, 2, 3):
        np.savez(tmp_path / f"{name.format(node)}.npz", frf=VALUE[:, 0], freq=FREQUENCY)
    new(tmp_path)
    text = campaign_text(tmp_path)
    assert f"output = {outputs}" in text
    assert ("# guessed: points are taken from the file names" in text) == (outputs != '["?"]')


def test_a_numpy_file_with_frfs_is_looked_into(tmp_path):
    np.savez(tmp_path / "frf.npz", frf=VALUE, freq=FREQUENCY)
    new(tmp_path)
    text = campaign_text(tmp_path)
    assert 'frf = "frf"' in text
    assert 'frequency = "freq"' in text


def test_a_complex_variable_called_a_spectrum_is_named_where_frfs_are_missing(tmp_path):
    savemat(tmp_path / "a.mat", {"yspec": VALUE})
    assert "complex variables 'yspec' look like spectra; name the one that holds FRFs" in " ".join(
        new(tmp_path).split()
    )


@pytest.mark.parametrize("head", ["# f re im\n\n", "#\n# f re im\n", "title of the test\n\n#\n"])
def test_an_empty_line_in_the_header_of_a_table_with_blanks(tmp_path, head):
    (tmp_path / "1+z_2+z.txt").write_text(head + columns(VALUE[:, 0].real, VALUE[:, 0].imag, delimiter=" "))
    new(tmp_path)
    fill(tmp_path, ('"?"', '"g/N"'))
    np.testing.assert_allclose(frf(tmp_path, tmp_path.name).value[0, 0], 9.80665 * VALUE[:, 0])
