"""Files as laboratories have them: units of axes, lines without numbers, parts with the same points, odd layouts."""

import re
import subprocess
import sys
import tracemalloc
from dataclasses import replace

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from ema.campaign.campaign import read_campaign
from ema.campaign.draft import draft
from ema.campaign.draft_file import draft_file
from ema.campaign.measurement import read_measurement
from ema.io.files import unit_in
from ema.io.measured_function import parse_unit, records_in
from ema.io.uff import read_uff_functions
from ema.io.uff58 import encode_58b
from ema.io.variables import VariableLayout, read_variables
from ema.quality.channels import check
from ema.types.errors import CampaignError, MeasurementError

VALUE = np.arange(1.0, 41.0) + 2j
HEADER = {
    "function type": 4,
    "response node": 1,
    "response direction": 3,
    "reference node": 2,
    "reference direction": 3,
    "abscissa specific data type": 18,
    "abscissa units label": "Hz",
    "ordinate numerator specific data type": 12,
    "ordinate numerator units label": "m/s^2",
    "ordinate denominator specific data type": 13,
    "ordinate denominator units label": "N",
}
POINTS = "node,x,y,z\n1,0,0,0\n2,1,0,0\n3,2,0,0\n4,3,0,0\n"
UNITS_OF_INCHES = (
    b"    -1\n   164\n         7Inch, lbf                   2\n"
    b"    3.93700787401574803D+01    2.24808943099710480D-01    1.80000000000000000D+00\n"
    b"    4.59670000000000020D+02\n    -1\n"
)
POINTS_OF_INCHES = b"    -1\n    15\n" + b"".join(
    b"%10d%10d%10d%10d%13.5E%13.5E%13.5E\n" % (n, 0, 0, 0, n, 0, 0) for n in (1, 2)
) + b"    -1\n"  # fmt: skip


def write(folder, *headers, name="a.uff", step=0.5, value=VALUE, before=b""):
    """Write a universal file with a function for each header."""
    content = before + b"".join(encode_58b(HEADER | header, 0.0, step, value) for header in headers)
    (folder / name).write_bytes(content)
    return folder / name


def campaign(folder, files="a.uff", more="", points='file = "points.csv"\nunit = "m"'):
    (folder / "points.csv").write_text(POINTS)
    text = f'[campaign]\nname = "t"\n[points]\n{points}\n{more}\n[[configuration]]\nname = "A"\nfiles = ["{files}"]\n'
    (folder / "campaign.toml").write_text(text)
    return read_measurement(read_campaign(folder / "campaign.toml"), "A")


@pytest.mark.parametrize(
    ("label", "kind", "factor"),
    [("kHz", 4, 1e3), ("rad/s", 4, 0.5 / np.pi), ("RPM", 4, 1 / 60), ("mHz", 4, 1e-3), ("NONE", 4, 1.0),
     ("kHz", 6, 1e3), ("ms", 1, 1e-3), ("usec", 1, 1e-6), ("min", 1, 60.0), ("s", 1, 1.0)],
)  # fmt: skip
def test_the_unit_of_the_abscissa_is_read(tmp_path, label, kind, factor):
    value = VALUE if kind == 4 else VALUE.real
    file = write(tmp_path, {"function type": kind, "abscissa units label": label}, value=value)
    (function,), _ = read_uff_functions(file)
    np.testing.assert_allclose(function.abscissa, 0.5 * factor * np.arange(40))


@pytest.mark.parametrize(("label", "kind"), [("ms", 4), ("furlong", 4), ("kHz", 1)])
def test_an_abscissa_of_another_unit_is_refused_with_its_label(tmp_path, label, kind):
    file = write(tmp_path, {"function type": kind, "abscissa units label": label})
    with pytest.raises(MeasurementError, match=rf"data set 1 \(58b\): field 'abscissa units label' is '{label}'"):
        read_uff_functions(file)


def test_spectra_over_anything_do_not_matter(tmp_path):
    file = write(tmp_path, {}, {"function type": 2, "abscissa units label": "orders"})
    assert [f.kind for f in read_uff_functions(file)[0]] == ["frf", "other"]


def test_units_beside_the_points_hold_for_functions_that_state_none(tmp_path):
    (tmp_path / "geo.uff").write_bytes(UNITS_OF_INCHES + POINTS_OF_INCHES)
    write(tmp_path, {"ordinate numerator units label": "NONE", "ordinate denominator units label": "NONE"})
    measured = campaign(tmp_path, points='file = "geo.uff"')
    np.testing.assert_allclose(measured.frf.value[0, 0], 0.0254 / 4.4482216 * VALUE, rtol=1e-6)


def test_units_that_nobody_stated_are_asked_for(tmp_path):
    write(tmp_path, {"ordinate numerator units label": "NONE", "ordinate denominator units label": "NONE"})
    assert any("takes" in n or "taken as SI" in n for n in campaign(tmp_path).notes)
    (tmp_path / "campaign.toml").unlink()
    assert any(line.startswith("measurement.unit") for line in draft_file(draft(tmp_path)).missing)


def test_a_general_function_over_frequencies_and_a_force_is_an_frf(tmp_path):
    file = write(tmp_path, {"function type": 0})
    (function,), notes = read_uff_functions(file)
    assert (function.kind, function.quantity) == ("frf", "accelerance")
    assert any("function type 0" in note for note in notes)


def test_a_dof_that_only_the_name_states(tmp_path):
    file = write(
        tmp_path, {"response node": 0, "response direction": 0, "response name": "12:-Z"}, {"response node": 0}
    )
    functions, _ = read_uff_functions(file)
    assert [f.output for f in functions] == [(12, -3), None]


def test_a_set_of_no_point_among_good_ones_is_left_out(tmp_path):
    write(tmp_path, {}, {"response node": -1}, {"response node": 3})
    measured = campaign(tmp_path)
    assert measured.frf.output.node.tolist() == [1, 3]
    assert any("data set 2" in n and "left out" in n for n in measured.notes)


def test_two_parts_with_the_same_point_numbers_are_not_merged(tmp_path):
    write(tmp_path, {"response name": "WING"}, {"response name": "TAIL"})
    with pytest.raises(MeasurementError, match=r"'TAIL' and 'WING'.*new_output"):
        campaign(tmp_path)


@pytest.mark.parametrize(("lost", "band"), [([0], None), ([20], None), ([0, 1, 2, 39], (5.0, 15.0)), ([0, 20], None)])
def test_lines_without_numbers_do_not_spoil_a_function(tmp_path, lost, band):
    value = VALUE.copy()
    value[lost] = np.nan
    write(tmp_path, {}, value=value)
    more = "" if band is None else f"[identification]\nband_Hz = {list(band)}"
    measured = campaign(tmp_path, more=more)
    assert np.isfinite(measured.frf.value).all()
    np.testing.assert_allclose(np.diff(measured.frf.frequency), 0.5)
    np.testing.assert_allclose(measured.frf.value[0, 0], (1.0 + 2.0 * measured.frf.frequency) + 2j)  # a straight line
    assert any("no numbers" in n or "numbers there" in n for n in measured.notes)


def test_a_function_that_lacks_many_numbers_is_left_to_the_check(tmp_path):
    value = VALUE.copy()
    value[10:20] = np.inf
    write(tmp_path, {}, value=value)
    assert np.count_nonzero(~np.isfinite(campaign(tmp_path).frf.value)) == 10


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.nc4", b"CDF", "its suffix '.nc4' is none of"),
        ("a.txt", b"1.0\n2.0\n3.0\n" * 9, "no rows of two or more columns"),
        ("a.uff", b"    -1\n    55\nNONE\n    -1\n", "it holds data sets 55"),
        ("b.uff", POINTS_OF_INCHES + b"    -1\n    55\nNONE\n    -1\n", "it holds data sets 15, 55"),
        ("a.uff", POINTS_OF_INCHES + b"    -1\n    58\nNONE\n    -1\n", "the header has 1 lines"),
        ("a.uff", encode_58b(HEADER | {"function type": 12}, 0.0, 0.5, VALUE), "neither FRFs .* nor time histories"),
    ],
)
def test_why_a_file_is_no_measurement(tmp_path, name, content, reason):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CampaignError, match=rf"{name}.*{reason}"):
        draft(tmp_path)


def test_files_with_frfs_outvote_more_files_of_coherences(tmp_path):
    axis = {"f": np.arange(1.0, 41.0)}
    for k in (1, 2):
        savemat(tmp_path / f"H{k}.mat", axis | {"H": VALUE})
    for k in (1, 2, 3):
        savemat(tmp_path / f"C{k}.mat", axis | {"coh": np.linspace(0.5, 1.0, 40)})
    found = draft(tmp_path)
    assert [c.file.name for c in found.contents] == ["H1.mat", "H2.mat"]


def test_h1_in_a_name_outweighs_fft(tmp_path):
    savemat(tmp_path / "a.mat", {"FFT1_H1_2_1_Y_ReIm": VALUE, "FFT1_AP_1_Y_ReIm": 2 * VALUE, "xIncrement": 0.5})
    (contents,) = draft(tmp_path).contents
    assert (contents.keys["frf"], contents.keys["axis_step"]) == ("FFT1_H1_2_1_Y_ReIm", 0.5)


@pytest.mark.parametrize("label", ["m s^-2/N", "ms-2/N", "m s-2 N-1", '"m/s2/N"', "ms^-2 N^-1", "mm s^-2/mN"])
def test_units_with_negative_powers(label):
    unit = parse_unit(label)
    assert (unit.factor, unit.frf) == (1.0, "accelerance")


@pytest.mark.parametrize(
    ("label", "factor"), [("g's/lbf", 2.204623), ("Gs/N", 9.80665), ("g/Newtons", 9.80665), ("g/Pounds", 2.204623)]
)
def test_units_as_programs_spell_them(label, factor):
    """ME'scope writes g's and Gs, LabVIEW Newtons and Pounds."""
    assert parse_unit(label).factor == pytest.approx(factor)


def test_a_label_that_is_not_understood_is_asked_for(tmp_path):
    """It was once taken as SI, ten times off where it was another spelling of g."""
    write(tmp_path, {"ordinate numerator units label": "gee"})
    (tmp_path / "points.csv").write_text(POINTS)
    missing = draft_file(draft(tmp_path)).missing
    assert any(line.startswith("measurement.unit: the file states gee, which is not") for line in missing)
    assert any("'gee' is not understood" in note and "[measurement] unit" in note for note in campaign(tmp_path).notes)


def test_fortran_s_exponents_in_the_header_of_a_universal_file(tmp_path):
    file = write(tmp_path, {})
    file.write_bytes(file.read_bytes().replace(b"5.0000000e-01", b"5.0000000D-01"))
    (function,), _ = read_uff_functions(file)
    np.testing.assert_allclose(function.abscissa, 0.5 * np.arange(40))


FORCE = {
    "function type": 1, "response node": 2, "reference node": 0, "ordinate numerator specific data type": 13,
    "ordinate numerator units label": "N", "abscissa units label": "s",
}  # fmt: skip
RESPONSE = FORCE | {
    "response node": 1, "ordinate numerator specific data type": 12, "ordinate numerator units label": "m/s^2",
}  # fmt: skip


def at(header, node):
    return header | {"response node": node}


@pytest.mark.parametrize(
    ("headers", "runs"),
    [
        ([FORCE, RESPONSE, at(RESPONSE, 3)], [1]),
        ([FORCE, RESPONSE, at(RESPONSE, 3)] * 4, [4]),
        ([FORCE] * 3 + [RESPONSE] * 3, [3]),
        ([FORCE, RESPONSE] * 2 + [at(FORCE, 3), RESPONSE] * 3, [2, 3]),
        ([FORCE, at(FORCE, 3), RESPONSE, at(RESPONSE, 4)], [1]),
        ([RESPONSE, FORCE, at(RESPONSE, 3), FORCE], [1, 1]),
        ([at(FORCE, 0), at(RESPONSE, 0), at(RESPONSE, 0)], [1]),
    ],
)
def test_blows_and_runs_in_one_universal_file(tmp_path, headers, runs):
    """Three blows at one point once passed for three forces at once."""
    functions, _ = read_uff_functions(write(tmp_path, *headers, value=VALUE.real))
    assert [len(run) for run in records_in(functions)] == runs


def test_universal_files_of_responses_alone_are_refused(tmp_path):
    write(tmp_path, RESPONSE, at(RESPONSE, 3), value=VALUE.real)
    with pytest.raises(CampaignError, match=r"of motions \(1\+z \[m/s\^2\], 3\+z .*an FRF needs a force"):
        draft(tmp_path)


def test_counts_of_samples_are_no_sampling_rate(tmp_path):
    """LabVIEW writes the step of times and frequencies, and beside it how many samples there are."""
    properties = {"wf_samples": 4096, "wf_increment": 1 / 1024, "wf_start_offset": 0.0}
    rng = np.random.default_rng(0)
    pulse = np.zeros(4096)
    pulse[100:104] = 1.0
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment(
            [
                ChannelObject("log", name, value, properties)
                for name, value in (("hammer", pulse), ("acc", rng.standard_normal(4096)))
            ]
        )
    (contents,) = draft(tmp_path).contents
    assert contents.keys["sampling_Hz"] == 1024.0
    frf = {"wf_samples": 40, "wf_increment": 0.25, "wf_start_offset": 5.0}
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment(
            [
                ChannelObject("frf", f"H {part}", value, frf)
                for part, value in (("real", VALUE.real), ("imag", VALUE.imag))
            ]
        )
    (contents,) = draft(tmp_path).contents
    assert (contents.keys["axis_start"], contents.keys["axis_step"]) == (5.0, 0.25)


@pytest.mark.parametrize(
    ("title", "written"),
    [
        ("Time", lambda t: f"10:15:{20 + t:09.6f}"),
        ("Date", lambda t: f"2021-03-01T10:15:{20 + t:09.6f}Z"),
        ("timestamp", lambda t: f"{1.6e9 + t:.6f}"),
        ("timestamp", lambda t: f"{1.6e12 + 1e3 * t:.3f}"),
        ("timestamp_ns", lambda t: f"{1.6e18 + 1e9 * t:.0f}"),
        ("millis", lambda t: f"{1e3 * t:.0f}"),
    ],
)
def test_times_as_recorders_write_them(tmp_path, title, written):
    """Clocks, and times since 1970, of which nothing was understood before."""
    time = np.arange(600) / 250.0
    pulse = np.where(np.arange(600) == 40, 50.0, 0.0)
    ringing = np.sin(99.0 * time)
    rows = (f"{written(t)},{f},{x:.6f}\n" for t, f, x in zip(time, pulse, ringing, strict=True))
    (tmp_path / "hit1.csv").write_text(f"{title},force [N],acc [m/s^2]\n" + "".join(rows))
    (tmp_path / "points.csv").write_text(POINTS)
    text = re.sub(r"# (output|input) = .*", r'\1 = ["1+z"]', draft_file(draft(tmp_path)).text)
    (tmp_path / "campaign.toml").write_text(text)
    measured = read_measurement(read_campaign(tmp_path / "campaign.toml"), tmp_path.name)
    np.testing.assert_allclose(measured.frf.frequency, np.arange(301) / 2.4, rtol=1e-5)


def test_what_is_not_filled_in_is_named_by_its_keys(tmp_path):
    """A "?" was once looked for among the variables of the file."""
    np.save(tmp_path / "H.npy", np.tile(VALUE, (2, 1)))
    (tmp_path / "campaign.toml").write_text(draft_file(draft(tmp_path)).text)
    with pytest.raises(CampaignError) as fault:
        read_campaign(tmp_path / "campaign.toml")
    for key in ("measurement.unit", "measurement.variables.frequency", "configuration[1].output[1]"):
        assert f'campaign.toml: {key}: is to be filled in, "?" stands there' in str(fault.value)


def test_points_of_a_universal_file_without_a_unit_are_given_one(tmp_path):
    """As ARTeMIS writes them: 30 was once 30 m without a word."""
    points = b"".join(b"%10d%10d%10d%10d%13.5E%13.5E%13.5E\n" % (n, 0, 0, 0, 15.0 * n, 0, 0) for n in (1, 2, 3))
    write(tmp_path, {}, before=b"    -1\n    15\n" + points + b"    -1\n")
    assert 'unit = "mm"  # guessed: the points span 30' in draft_file(draft(tmp_path)).text
    write(tmp_path, {}, before=UNITS_OF_INCHES + POINTS_OF_INCHES)
    assert draft(tmp_path).points.unit is None


def test_folders_of_points_are_no_states(tmp_path):
    for k in (1, 2):
        (tmp_path / f"point_{k}").mkdir()
        write(tmp_path, {"reference node": k}, name=f"point_{k}/a.uff")
    (tmp_path / "p1").mkdir()
    write(tmp_path, {}, name="p1/a.uff")
    found = draft(tmp_path).configurations
    assert {name: len(contents) for name, contents in found.items()} == {"p1": 1, tmp_path.name: 2}


def test_a_unit_in_quotes():
    assert unit_in('"Frequency" "Hz" "g/N"') == "g/N"


def test_fixed_sensors_and_a_roving_hammer_are_one_run(tmp_path):
    for force in (1, 2, 3):
        write(tmp_path, *({"response node": n, "reference node": force} for n in (3, 4)), name=f"hit_{force}.uff")
    (tmp_path / "points.csv").write_text(POINTS)
    text = draft_file(draft(tmp_path)).text
    (tmp_path / "campaign.toml").write_text(text)
    measured = read_measurement(read_campaign(tmp_path / "campaign.toml"), tmp_path.name)
    assert "roves" in text
    assert set(measured.frf.run.tolist()) == {0}
    assert measured.frf.value.shape[:2] == (3, 2)


def peak_of(run):
    tracemalloc.start()
    try:
        run()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_memory_of_large_universal_files(tmp_path):
    """A first campaign file needs headers alone; reading needs little more than the functions themselves."""
    value = np.resize(VALUE, 12_000)
    write(tmp_path, *({"response node": n} for n in range(1, 41)), value=value)
    arrays = 40 * value.nbytes
    campaign_file = "".join(f"{n},{n},0,0\n" for n in range(5, 41))
    (tmp_path / "points.csv").write_text(POINTS + campaign_file)
    assert peak_of(lambda: draft_file(draft(tmp_path))) < 0.1 * arrays
    (tmp_path / "campaign.toml").write_text(draft_file(draft(tmp_path)).text)
    read = read_campaign(tmp_path / "campaign.toml")
    assert peak_of(lambda: read_measurement(read, tmp_path.name)) < 2.5 * arrays
    measured = read_measurement(read, tmp_path.name)
    noise = np.random.default_rng(0).normal(size=measured.frf.value.shape)  # so that no channel is as another one
    measured = replace(measured, frf=replace(measured.frf, value=measured.frf.value * (1.0 + noise)))
    check(measured, (1.0, 100.0))  # imports what it needs
    assert peak_of(lambda: check(measured)) < 2.0 * arrays


@pytest.mark.skipif(sys.platform != "linux", reason="memory is counted in kB on Linux")
def test_a_first_campaign_file_needs_no_numbers_of_a_file(tmp_path):
    """Of 2 GB, here empty, nothing but the headers is looked at; pages that were mapped once counted as memory."""
    n_value, header = 125_000_000, encode_58b(HEADER, 0.0, 0.5, VALUE)
    head = header[: header.index(b"    -1\n    58b") + 4096].replace(b"        40", b" 125000000", 1)
    head = head[: len(header) - len(VALUE) * 8 - len(b"    -1\n")]
    with (tmp_path / "a.uff").open("wb") as file:
        for _ in range(2):
            file.write(head)
            file.seek(8 * n_value, 1)
            file.write(b"\n    -1\n")
    code = (
        "import sys\nfrom pathlib import Path\nfrom updating.commands.new import new_command\n"
        "new_command(Path(sys.argv[1]))\nprint(open('/proc/self/status').read().partition('VmHWM:')[2].split()[0])"
    )  # getrusage would tell the peak of the process this one was started from
    done = subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, text=True, check=True)
    assert "2 functions" in done.stdout
    assert int(done.stdout.split()[-1]) < 200_000


def test_records_of_unequal_lengths_share_their_lines(tmp_path):
    rng = np.random.default_rng(0)
    for run, n_sample in enumerate((912, 903, 910), start=1):
        force = np.zeros(n_sample)
        force[5:8] = 1.0, 2.0, 1.0
        response = np.convolve(force, np.exp(-0.02 * np.arange(n_sample)) * rng.standard_normal(n_sample))[:n_sample]
        rows = "".join(
            f"{k / 1000:.4f},{f:.6f},{x:.6f}\n" for k, (f, x) in enumerate(zip(force, response, strict=True))
        )
        (tmp_path / f"run_{run}.csv").write_text(rows)
    more = (
        '[measurement.table]\nlayout = "time"\n[measurement.time]\nwindow = "boxcar"\nforce_unit = "N"\n'
        'response_unit = "m/s2"'
    )
    (tmp_path / "points.csv").write_text(POINTS)
    (tmp_path / "campaign.toml").write_text(
        f'[campaign]\nname = "t"\n[points]\nfile = "points.csv"\nunit = "m"\n{more}\n[[configuration]]\n'
        'name = "A"\nfiles = ["run_*.csv"]\noutput = ["1+z", "2+z", "3+z"]\ninput = ["4+z"]\n'
    )
    measured = read_measurement(read_campaign(tmp_path / "campaign.toml"), "A")
    assert measured.frf.value.shape == (3, 1, 903 // 2 + 1)
    assert any("903 to 912 samples" in note for note in measured.notes)


def measured_as_drafted(folder, **filled):
    """Read what `lamella new` drafts of a folder, with the values of keys that it asks for."""
    text = draft_file(draft(folder)).text
    for key, value in filled.items():
        text = re.sub(rf"(?m)^{key} = .*\?.*$", f"{key} = {value}", text)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    campaign = read_campaign(folder / "campaign.toml")
    return read_measurement(campaign, campaign.configurations[0].name)


def comma(text):
    return text.replace(",", "_").replace(".", ",").replace("_", ".")


@pytest.mark.parametrize(
    ("separator", "write"),
    [
        (",", lambda x: f'"{x:,.4f}"'),
        ("\t", lambda x: f"{x:,.4f}"),
        (";", lambda x: comma(f"{x:,.4f}")),
        (";", lambda x: f"{x:,.4f}".replace(",", "'")),
        ("\t", lambda x: comma(f"{x:,.4f}").replace(".", "\u202f")),
        (";", lambda x: f"{x:.3f}".replace(".", ",")),  # a decimal comma before three digits is no thousand
    ],
)
def test_numbers_with_their_thousands_apart_are_read_whole(tmp_path, separator, write):
    """Rows from 1,000.0 Hz on once were taken for words below the table, and left out without one."""
    f = np.arange(990.0, 1090.0, 0.5)
    value = 1500.0 * np.exp(1j * f / 30.0)
    rows = [separator.join(map(write, (a, b.real, b.imag))) for a, b in zip(f, value, strict=True)]
    head = separator.join(["Frequency (Hz)", "Real (m/s2/N)", "Imag (m/s2/N)"])
    (tmp_path / "FRF_1z_2z.csv").write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    measured = measured_as_drafted(tmp_path)
    np.testing.assert_allclose(measured.frf.frequency, f)
    np.testing.assert_allclose(measured.frf.value[0, 0], value, atol=6e-4)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("kind", ["mat", "npz", "npy"])
@pytest.mark.parametrize("polar", [False, True])
def test_frequency_and_both_parts_in_one_array_are_read(tmp_path, kind, turned, polar):
    f = np.arange(0.0, 200.0, 0.5)
    value = np.exp(1j * f / 30.0) * (1.0 + f / 100.0)
    parts = (np.abs(value), np.degrees(np.angle(value))) if polar else (value.real, value.imag)
    table = np.column_stack([f, *parts])
    table = table.T if turned else table
    path = tmp_path / f"H_1z_2z.{kind}"
    if kind == "mat":
        savemat(path, {"FRF": table})
    elif kind == "npz":
        np.savez(path, frf=table)
    else:
        np.save(path, table)
    measured = measured_as_drafted(tmp_path, unit='"(m/s2)/N"')
    np.testing.assert_allclose(measured.frf.frequency, f)
    np.testing.assert_allclose(measured.frf.value[0, 0], value, atol=1e-9)


def test_several_functions_beside_one_frequency_are_read_and_a_time_is_none(tmp_path):
    f = np.arange(0.0, 200.0, 0.5)
    value = np.array([np.exp(1j * f / (30.0 + k)) for k in range(3)])
    savemat(
        tmp_path / "all.mat", {"FRF": np.column_stack([f, *(part for one in value for part in (one.real, one.imag))])}
    )
    dofs = {"output": '["1+z", "2+z", "3+z"]', "input": '["1+z"]'}
    measured = measured_as_drafted(tmp_path, unit='"(m/s2)/N"', **dofs)
    np.testing.assert_allclose(measured.frf.value[:, 0], value, atol=1e-12)
    savemat(tmp_path / "all.mat", {"record": np.column_stack([f / 1000.0, *value[:2].real])})
    assert "real" not in draft_file(draft(tmp_path)).text.partition("[measurement.variables]")[2]


def test_two_columns_that_are_both_parts_are_read_with_the_step_that_the_file_states(tmp_path):
    """As in leekunhwee/Vibration-Signal-Processing, FRFGeneration/H00.mat."""
    value = np.exp(1j * np.arange(400) / 30.0)
    savemat(tmp_path / "H00.mat", {"H00": np.column_stack([value.real, value.imag]), "df": 0.5, "f_start": 0})
    measured = measured_as_drafted(tmp_path, unit='"m/N"', output='["1+z"]', input='["1+z"]')
    np.testing.assert_allclose(measured.frf.frequency, 0.5 * np.arange(400))
    np.testing.assert_allclose(measured.frf.value[0, 0], value, atol=1e-12)


@pytest.mark.parametrize("part", ["[:, 7]", "[:, 1:x]", "[0, 0, 0]"])
def test_a_part_that_an_array_does_not_have_is_named(tmp_path, part):
    np.save(tmp_path / "H.npy", np.column_stack([np.arange(50.0), np.ones((50, 2))]))
    layout = VariableLayout(
        real=(f"array{part}",), imaginary=("array[:, 2]",), frequency="array[:, 0]", axes=("frequency",)
    )
    with pytest.raises(MeasurementError, match=r"no numbers of that name; the file holds array \(50 x 3\)"):
        read_variables(tmp_path / "H.npy", layout, None, matlab=False)


@pytest.mark.parametrize("share", [0.3, 0.5])
def test_a_tdms_file_that_is_cut_off_before_its_last_channel_is_named_so(tmp_path, share):
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment([ChannelObject("hit", name, np.arange(400.0)) for name in ("force", "acc")])
    content = (tmp_path / "a.tdms").read_bytes()
    (tmp_path / "a.tdms").write_bytes(content[: int(share * len(content))])
    with pytest.raises(CampaignError, match=r"a\.tdms: is cut off"):
        draft(tmp_path)


def test_names_of_dewesoft_state_axes_parts_and_dofs(tmp_path):
    """As in elchape99/SSCSA: each variable has its frequencies beside it, by the same name with an X."""
    f = np.arange(0.0, 200.0, 0.5)
    value = np.exp(1j * f / 30.0) * (2.0 + np.cos(f))
    parts = {"Coherence": np.full(f.size, 0.9), "FRF_H1_Ampl": np.abs(value), "FRF_H1_Phase": np.angle(value)}
    names = {key: key.replace("_H1", "_H1_2Zplus_1Yminus") + "_2Zplus_1Yminus" * (key == "Coherence") for key in parts}
    axes = {f"Data1_X_MT_{names[key]}": f.astype(np.float32) for key in parts}
    savemat(tmp_path / "a.mat", axes | {f"Data1_MT_{names[key]}": part for key, part in parts.items()})
    measured = measured_as_drafted(tmp_path, unit='"(m/s)/N"')
    np.testing.assert_allclose(measured.frf.value[0, 0], value, atol=1e-9)
    np.testing.assert_allclose(measured.frf.frequency, f)
    assert draft(tmp_path).contents[0].keys["coherence"] == "Data1_MT_Coherence_2Zplus_1Yminus"
    assert measured.frf.output.name(0) == "2+z"
    assert measured.frf.input.name(0) == "1-y"


@pytest.mark.parametrize("kind", ["h5", "mat", "npz"])
def test_a_list_of_texts_names_the_channels_of_an_array(tmp_path, kind):
    """As in ladisk/mssp-image-tutorial, where a trigger is a shorter pulse than the force."""
    record = np.zeros((3, 2000))
    record[0, 40:48] = np.hanning(8)
    record[1] = np.exp(-np.arange(2000) / 400.0) * np.sin(np.arange(2000) / 9.0)
    record[2, :3] = 1.0
    names = ["force", "acc", "trigger"]
    if kind == "h5":
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file["data"], file["channel_names"], file["fs"] = record, names, 1000.0
    elif kind == "mat":
        savemat(tmp_path / "a.mat", {"data": record, "names": np.array(names, dtype=object), "fs": 1000.0})
    else:
        np.savez(tmp_path / "a.npz", data=record, names=names, fs=1000.0)
    assert "force = 1  # guessed: its title says so" in draft_file(draft(tmp_path)).text


@pytest.mark.parametrize("order", ["fft", "shifted"])
def test_two_sided_functions_of_matlab_are_read_from_0_Hz(tmp_path, order):
    """As NumPy and MATLAB write them: their vectors are rows there, and negative frequencies come last, or first."""
    f = np.fft.fftfreq(800, 1 / 400.0)
    one = np.exp(1j * np.arange(401) / 30.0)
    two = np.concatenate([one[:400], [1.0], one[399:0:-1].conj()])
    shift = np.fft.fftshift if order == "shifted" else np.asarray
    savemat(tmp_path / "a.mat", {"H": shift(two)[:, None] * [1.0, 2.0], "f": shift(f)})
    measured = measured_as_drafted(tmp_path, unit='"(m/s2)/N"', output='["1+z", "2+z"]', input='["1+z"]')
    np.testing.assert_allclose(measured.frf.frequency, f[:400])
    np.testing.assert_allclose(measured.frf.value[0, 0], one[:400])


def test_functions_of_finer_lines_are_used_on_the_lines_that_all_have(tmp_path):
    for k, step in enumerate((1.0, 0.5, 1.0), start=1):
        f = np.arange(0.0, 200.0 + step / 2, step)
        rows = np.column_stack([f, np.cos(f / 30.0) + k, np.sin(f / 30.0)])
        np.savetxt(tmp_path / f"H{k}z_3z.csv", rows, delimiter=",", header="f [Hz],real [g/N],imag [g/N]", comments="")
    measured = measured_as_drafted(tmp_path)
    np.testing.assert_allclose(measured.frf.frequency, np.arange(201.0))
    assert [measured.frf.output.name(k) for k in range(3)] == ["1+z", "2+z", "3+z"]
    assert measured.frf.input.name(0) == "3+z"
    np.testing.assert_allclose(measured.frf.value[1, 0].imag, 9.80665 * np.sin(np.arange(201.0) / 30.0), atol=1e-9)
    assert any("of 1 functions, such as" in note and "1 Hz apart" in note for note in measured.notes)


def test_points_without_functions_are_said_to_be_points(tmp_path):
    (tmp_path / "geometry.unv").write_bytes(POINTS_OF_INCHES)
    with pytest.raises(
        CampaignError, match=r"geometry\.unv: lists points alone; put the files of the functions beside"
    ):
        draft(tmp_path)
