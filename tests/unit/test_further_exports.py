"""Further files of laboratories: functions below each other, columns in any order, sound, copies, shifted rows."""

import shutil

import numpy as np
import pytest
from scipy.io import savemat, wavfile

from ema.campaign.campaign import read_campaign
from ema.campaign.draft import draft
from ema.campaign.draft_file import draft_file
from ema.campaign.measurement import read_measurement
from ema.io.files import unit_in
from ema.io.uff58 import encode_58b
from ema.types.errors import CampaignError, MeasurementError

F = np.arange(1.0, 41.0)
H = np.array([(k + 1) * (F - 20.0 + 3j) for k in range(3)]).T  # (line, point)
UNIT = '"(m/s2)/N"'
OUTPUT = '["1+z", "2+z", "3+z"]'


def measured(folder, **filled):
    """Return what is read by the campaign file that `lamella new` drafts, with these keys filled in."""
    drafted = draft(folder)
    lines = []
    for row in draft_file(drafted).text.splitlines():
        key = row.lstrip("# ").partition(" = ")[0]
        asked = key in filled and ('"?"' in row or (key in ("input", "output") and "to be filled in" in row))
        lines.append(f"{key} = {filled[key]}" if asked else row)
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n")
    campaign = read_campaign(folder / "campaign.toml")
    return drafted, read_measurement(campaign, campaign.configurations[0].name)


def check(frf, value=H):
    assert frf.output.node.tolist() == [1, 2, 3]
    np.testing.assert_allclose(frf.value[:, 0].T, value, rtol=1e-6)


ROWS = [(p, f, h) for p in range(3) for f, h in zip(F, H[:, p], strict=True)]
LONG = {
    "point and direction": (
        "resp_node,resp_dir,ref_node,ref_dir,freq_hz,real,imag\n",
        [f"{p + 1},Z,1,Z,{f},{h.real},{h.imag}" for p, f, h in ROWS],
    ),
    "a point alone": ("point;Frequenz [Hz];Betrag [(m/s²)/N];Phase [rad]\n", [
        f"{p + 1};{f};{abs(h)};{np.angle(h)}".replace(".", ",") for p, f, h in ROWS]),
    "one line after the other": ("# of 2024\nf [Hz]\tdof out\tdof in\tH\tcoherence\n", [
        f"{f}\t{p + 1}+z\t1+z\t{h.real}{h.imag:+}j\t0.9" for p, f, h in sorted(ROWS, key=lambda row: row[1])]),
}  # fmt: skip


@pytest.mark.parametrize("kind", LONG)
def test_functions_below_each_other_with_their_dofs_in_columns(tmp_path, kind):
    head, rows = LONG[kind]
    (tmp_path / "a.csv").write_text(head + "\n".join(rows) + "\n")
    check(measured(tmp_path, unit=UNIT, input='"1+z"')[1].frf)


def test_a_cell_that_is_no_dof_is_named(tmp_path):
    head, rows = LONG["point and direction"]
    (tmp_path / "a.csv").write_text(head + "\n".join(rows) + "\n")
    measured(tmp_path, unit=UNIT)
    rows[50] = rows[50].replace("2,Z", "2,W")
    (tmp_path / "a.csv").write_text(head + "\n".join(rows) + "\n")
    with pytest.raises(
        MeasurementError, match=r"a.csv: row 52, column 1, 2: expected a DOF such as 12\+z, found '2', 'W'"
    ):
        read_measurement(read_campaign(tmp_path / "campaign.toml"), tmp_path.name)


def test_decibels_re_one_and_frequencies_behind_another_column(tmp_path):
    for p in range(3):
        rows = zip(np.full(40, 0.99), F, 20 * np.log10(abs(H[:, p])), np.degrees(np.angle(H[:, p])), strict=True)
        head = "Coherence\tFrequency [Hz]\tMagnitude [dB re 1 (m/s2)/N]\tPhase [deg]\n"
        (tmp_path / f"P{p + 1}.txt").write_text(head + "\n".join("\t".join(map(str, row)) for row in rows))
    measurement = measured(tmp_path, input='"1+z"')[1]
    check(measurement.frf)
    assert measurement.frf.coherence.max() == 0.99


HEADER = (
    "Point Index:\t{p}\nExcitation DOF:\t1+Z\nResponse DOF:\t{p}+Z\n\nFrequency\tReal\tImag\n[ Hz ]\t{unit}\t{unit}\n"
)


@pytest.mark.parametrize("stated", ["point", "both"])
def test_points_and_ends_that_headers_state(tmp_path, stated):
    for p in range(3):
        rows = HEADER.format(p=p + 1, unit="[ (m/s^2) / N ]").splitlines()
        rows = [row for row in rows if row.startswith("Point") or "DOF" not in row] if stated == "point" else rows[1:]
        rows += ["\t".join(map(str, row)) for row in zip(F, H[:, p].real, H[:, p].imag, strict=True)]
        (tmp_path / f"FRF{p + 1}.txt").write_text("\n".join(rows))
    frf = measured(tmp_path, input='"1+z"')[1].frf
    check(frf)
    assert not frf.reciprocal


def test_a_unit_with_blanks_in_brackets():
    assert unit_in("Frequency [ Hz ] [ (m/s) / N ]") == "(m/s)/N"


def table(folder, name="a.csv", value=H):
    columns = [c for p in range(value.shape[1]) for c in (value[:, p].real, value[:, p].imag)]
    titles = ",".join(f"{p + 1}z real,{p + 1}z imag" for p in range(value.shape[1]))
    rows = [",".join(map(str, row)) for row in np.column_stack([F, *columns])]
    (folder / name).write_text(f"Hz,{titles}\n" + "\n".join(rows) + "\n")
    return folder / name


def test_a_copy_is_no_measurement_of_its_own(tmp_path):
    for p in range(3):
        table(tmp_path, f"H{p + 1}.csv", H[:, [p]] if p else H[:, [0]])
    shutil.copy(tmp_path / "H2.csv", tmp_path / "H2 (1).csv")
    (tmp_path / "H3 - Copy.csv").write_text((tmp_path / "H1.csv").read_text())
    assert any(line.endswith("H2 (1).csv: is a copy of H2.csv") for line in draft(tmp_path).left_out)
    (contents,) = draft(tmp_path).configurations.values()
    assert [c.file.name for c in contents] == ["H1.csv", "H2.csv", "H3.csv"]


def test_a_row_with_a_number_more_is_named(tmp_path):
    path = table(tmp_path)
    measured(tmp_path, unit=UNIT, input='"1+z"')
    rows = path.read_text().splitlines()
    path.write_text("\n".join([*rows[:9], "1," + rows[9], *rows[10:]]))
    with pytest.raises(MeasurementError, match=r"a.csv: row 10 has 8 numbers, and the others 7: columns are shifted"):
        read_measurement(read_campaign(tmp_path / "campaign.toml"), tmp_path.name)


@pytest.mark.parametrize(("old", "new", "said"), [
    ('name = "NAME"\n#', 'name = " "\n#', r"configuration\[1\].name: a configuration needs a name"),
    ("[[configuration]]", '[[correction]]\nscale = 0\nreason = "x"\n[[configuration]]', r"correction\[1\].scale: "),
])  # fmt: skip
def test_an_empty_name_and_a_factor_of_nothing_are_refused(tmp_path, old, new, said):
    table(tmp_path)
    measured(tmp_path, unit=UNIT, input='"1+z"')
    file = tmp_path / "campaign.toml"
    file.write_text(file.read_text().replace(old.replace("NAME", tmp_path.name), new))
    with pytest.raises(CampaignError, match=said):
        read_campaign(file)


def universal(folder, values):
    head = {"function type": 4, "response node": 1, "response direction": 3, "reference node": 2,
            "reference direction": 3, "abscissa specific data type": 18, "ordinate numerator specific data type": 12,
            "ordinate numerator units label": "m/s^2", "ordinate denominator specific data type": 13,
            "ordinate denominator units label": "N"}  # fmt: skip
    (folder / "a.uff").write_bytes(b"".join(encode_58b(head, 1.0, 1.0, value) for value in values))


def test_functions_of_one_dof_that_are_no_repeats_are_refused(tmp_path):
    universal(tmp_path, [H[:, 0], 0.9 * H[:, 0]])
    assert any("measured twice" in note for note in measured(tmp_path)[1].notes)
    universal(tmp_path, [H[:, 0], np.roll(H[:, 0], 20)])
    with pytest.raises(MeasurementError, match=r"both 1\+z over 2\+z, but differ by .* neither repeats the other"):
        read_measurement(read_campaign(tmp_path / "campaign.toml"), tmp_path.name)


def test_lines_that_old_macintoshes_end(tmp_path):
    rows = [f"{'NONE':80}"] * 5 + [
        f"{4:5}{1:10}{0:5}{0:10} {'NONE':10}{1:10}{3:4} {'NONE':10}{1:10}{3:4}",
        f"{5:10}{40:10}{1:10}{1.0:13.5E}{1.0:13.5E}{0.0:13.5E}",
        f"{18:10}{0:5}{0:5}{0:5} {'Frequency':20} {'Hz':20}",
        f"{12:10}{0:5}{0:5}{0:5} {'Acceleration':20} {'m/s^2':20}",
        f"{13:10}{0:5}{0:5}{0:5} {'Force':20} {'N':20}",
        f"{0:10}{0:5}{0:5}{0:5} {'NONE':20} {'NONE':20}",
        *(f"{h.real:13.5E}{h.imag:13.5E}" for h in H[:, 0]),
    ]
    (tmp_path / "a.unv").write_bytes("\r".join(["    -1", "    58", *rows, "    -1", ""]).encode())
    np.testing.assert_allclose(measured(tmp_path)[1].frf.value[0, 0], H[:, 0], rtol=1e-4)


@pytest.mark.parametrize("kind", ["mat", "npz", "struct"])
def test_a_unit_that_is_text_in_a_file_of_arrays(tmp_path, kind):
    if kind == "npz":
        np.savez(tmp_path / "a.npz", H=H, f=F, units="mm/s^2/N")
    else:
        content = {"H": H, "f": F, "unit": "mm/s^2/N"}
        savemat(
            tmp_path / "a.mat", {"d": {"frf": {"H": H, "f": F}, "unit": "mm/s^2/N"}} if kind == "struct" else content
        )
    check(measured(tmp_path, input='"1+z"', output=OUTPUT)[1].frf, 1e-3 * H)


def test_hdf5_of_another_suffix(tmp_path):
    import h5py

    with h5py.File(tmp_path / "a.nc", "w") as file:
        file["H_real"], file["H_imag"], file["frequency"] = H.real, H.imag, F
    check(measured(tmp_path, unit=UNIT, input='"1+z"', output=OUTPUT)[1].frf)


@pytest.mark.parametrize("mono", [False, True])
def test_sound_files_are_drafted_and_ask_for_their_calibration(tmp_path, mono):
    time = np.arange(400)
    force = np.where(time == 20, 0.5, 0.0)
    responses = [0.1 * (p + 1) * np.exp(-0.02 * (time - 20)) * (time >= 20) for p in range(3)]
    if mono:
        names = ["hammer", "acc_1z", "acc_2z", "acc_3z"]
        for name, record in zip(names, (force, *responses), strict=True):
            wavfile.write(tmp_path / f"{name}.wav", 1000, record.astype("float32"))
    else:
        wavfile.write(tmp_path / "a.wav", 1000, np.column_stack([force, *responses]).astype("float32"))
    units = {"force_unit": '"N"', "response_unit": '"m/s2"'}
    frf = measured(tmp_path, full_scale="[200, 50, 50, 50]", input='"1+z"', output=OUTPUT, **units)[1].frf
    check(frf, np.fft.rfft(responses).T / np.fft.rfft(force)[:, None] / 4)


def test_accelerations_alone_are_no_test_with_a_force(tmp_path):
    rows = np.column_stack([0.01 * np.arange(40), np.random.default_rng(1).normal(size=(40, 3))])
    (tmp_path / "a.csv").write_text("time,acc1,acc2,acc3\n" + "\n".join(",".join(map(str, r)) for r in rows))
    with pytest.raises(CampaignError, match=r"all its channels are of motions \(acc1, acc2, acc3\)"):
        draft(tmp_path)


@pytest.mark.parametrize(("text", "said"), [
    ("mode,pole\n" + "\n".join(f"{k},{-k}+{k}j" for k in range(4)), "only 4 rows of two or more numbers, too few"),
    ("\n".join(",".join(map(str, row)) for row in (F, *[np.cos(F)] * 12)), "row 1 ascends as frequencies do"),
])  # fmt: skip
def test_why_a_table_is_no_measurement(tmp_path, text, said):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(CampaignError, match=said):
        draft(tmp_path)


def test_a_title_of_two_dofs_and_decibels_of_a_unit(tmp_path):
    for p in range(3):
        rows = zip(F, 20 * np.log10(abs(H[:, p])), np.degrees(np.angle(H[:, p])), strict=True)
        head = f"Title1\tFRF plate:{p + 1}:+Z/plate:1:+Z\nFrequency [Hz]\tAmplitude (dB re 1 g/N)\tPhase [deg]\n"
        (tmp_path / f"H{p + 1}.prn").write_text(head + "\n".join("\t".join(map(str, row)) for row in rows))
    check(measured(tmp_path)[1].frf, 9.80665 * H)


@pytest.mark.parametrize(
    ("head", "unit"), [("Point;X [cm];Y [cm];Z [cm]", "cm"), ("node,x,y,z", "m"), ("No;X;Y;Z", None)]
)
def test_lists_of_points_of_other_programs(tmp_path, head, unit):
    table(tmp_path)
    rows = [head] + [f"{p}; {p},5;0;0" if ";" in head else f"{p},{p}.5,0,0" for p in (1, 2, 3)]
    (tmp_path / "geometry.csv").write_text("\n".join(rows))
    points = draft(tmp_path).points
    assert (None if points is None else points.unit) == unit
    assert points is None or points.node == (1, 2, 3)


def test_a_logger_that_says_that_its_spectra_are_transfer_functions(tmp_path):
    # Cambridge's data logger: "freq" is the sampling rate of "npts" samples
    content = {"yspec": H, "freq": 2.0 * (len(H) - 1) * 0.75, "npts": 2 * (len(H) - 1), "dt2": [0, 3, 0]}
    savemat(tmp_path / "a.mat", content | {"tfun": 1})
    frf = measured(tmp_path, unit=UNIT, input='"1+z"', output=OUTPUT)[1].frf
    check(frf)
    np.testing.assert_allclose(frf.frequency, 0.75 * np.arange(len(H)))
    savemat(tmp_path / "a.mat", content | {"tfun": 0})
    asked = draft_file(draft(tmp_path)).missing
    assert any("look like spectra" in said for said in asked)
    np.save(tmp_path / "a.npy", H)
    (tmp_path / "a.mat").unlink()
    assert any("give axis_step in Hz" in said for said in draft_file(draft(tmp_path)).missing)


def test_titles_with_units_that_are_separated_otherwise_than_the_numbers(tmp_path):
    time = np.arange(2000) / 1000.0
    force = np.where(np.arange(2000) == 20, 100.0, 0.0)
    rows = "\n".join(f"{t}\t{f}\t{np.sin(300 * t)}" for t, f in zip(time, force, strict=True))
    (tmp_path / "a.txt").write_text(f"T[s] F[N] A[g]\n{rows}\n")
    text = draft_file(draft(tmp_path)).text
    assert 'force_unit = "N"' in text
    assert 'response_unit = "g"' in text
    assert "force = 1  # guessed: its title says so" in text


def test_a_header_that_states_a_time_is_no_title_of_the_rows_that_are_counted(tmp_path):
    # PULSE LabShop: FRFs were taken for time histories whose times are the numbers of the rows
    head = ["Data Type:\tComplex\t \t ", "X-Axis unit:\tHz\t \t ", "AmplitudeUnit:\t(m/s²)/N\t \t ",
            "Function:\tFrequency Response\t \t ", "Ref Signal:\thammer\t \t ", "Time:\t \t11:02:07\t "]  # fmt: skip
    rows = [f"{k + 1}\t {f:.10e}\t {h.real:.8e}\t{h.imag:.8e}" for k, (f, h) in enumerate(zip(F, H[:, 0], strict=True))]
    (tmp_path / "a.txt").write_text("\n".join([*head, *rows]) + "\n", encoding="latin-1")
    frf = measured(tmp_path, input='["1+z"]', output='["1+z"]')[1].frf
    np.testing.assert_allclose(frf.value[0, 0], H[:, 0], rtol=1e-6)


def test_points_directions_and_units_in_rows_of_a_header(tmp_path):
    rows = [["Point", 1, 1, 2, 2, 3, 3], ["Direction", *["+Z"] * 6], ["Part", *["Re", "Im"] * 3]]
    rows += [["Unit", *["mm s-2 N-1"] * 6], ["Reference", *["3:+Z"] * 6]]
    value = 1.0 / H
    rows += [[f, *(1e3 * p for h in row for p in (h.real, h.imag))] for f, row in zip(F, value, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(",".join(map(str, row)) for row in rows) + "\n")
    frf = measured(tmp_path)[1].frf
    check(frf, value)
    assert frf.input.name(0) == "3+z"


def test_an_apparent_mass_is_refused_by_its_title(tmp_path):
    rows = [f"{f},{h.real},{h.imag}" for f, h in zip(F, 1.0 / H[:, 0], strict=True)]
    (tmp_path / "P1.csv").write_text("Frequency [Hz],Real [kg],Imag [kg]\n" + "\n".join(rows) + "\n")
    with pytest.raises(CampaignError, match="states the unit kg, which is no response over a force"):
        draft(tmp_path)


@pytest.mark.parametrize("label", ["m s-2 N-1", "Acc [m s⁻² N⁻¹]", "m·s⁻²·N⁻¹"])
def test_units_of_negative_powers_are_found_in_headers(label):
    assert unit_in(label) == label.removeprefix("Acc [").removesuffix("]")
    assert unit_in("run-1 of 2024-01-01") is None


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("n", [40, 41])
def test_mirror_images_above_half_the_sampling_rate_are_left_out(tmp_path, first, n):
    history = np.random.default_rng(0).standard_normal((n, 3))
    whole = np.fft.fft(history, axis=0)
    np.savez(tmp_path / "a.npz", FRF=whole[first:], freq=0.5 * np.arange(first, n))
    found = measured(tmp_path, unit=UNIT, output=OUTPUT, input='"1+z"')[1]
    lines = slice(first, n // 2 + 1)
    assert found.frf.frequency.tolist() == (0.5 * np.arange(n))[lines].tolist()
    check(found.frf, whole[lines])
    assert any("mirror those below; left out" in note for note in found.notes)


def test_volts_over_volts_ask_for_two_sensitivities(tmp_path):
    rows = [f"{f},{h.real},{h.imag}" for f, h in zip(F, H[:, 0], strict=True)]
    (tmp_path / "1z.csv").write_text("f [Hz],Re [V/V],Im [V/V]\n" + "\n".join(rows) + "\n")
    told = '"V/V/(100 mV/g)*(2.25 mV/N)"'
    assert any(told in missing for missing in draft_file(draft(tmp_path)).missing)
    frf = measured(tmp_path, unit=told, output='"1+z"', input='"1+z"')[1].frf
    np.testing.assert_allclose(frf.value[0, 0], H[:, 0] * 9.80665 * 2.25 / 100.0)
