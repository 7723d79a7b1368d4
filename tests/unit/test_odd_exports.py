"""Kinds of files that public measured sets held: headers of several lengths, a row that is off, Testlab's labels."""

import numpy as np
import pytest
from scipy.io import savemat

from ema.campaign.campaign import read_campaign
from ema.campaign.draft import draft
from ema.campaign.draft_file import draft_file
from ema.campaign.measurement import read_measurement
from ema.io.array_files import arrays_in
from ema.io.guess_table import guess_table
from ema.types.errors import CampaignError

LINES = 0.5 * np.arange(1, 41)
VALUE = np.arange(1.0, 41.0) - 2j


def rows(scale=1.0):
    return [f"{f:g}\t{(scale * v).real:g}\t{(scale * v).imag:g}" for f, v in zip(LINES, VALUE, strict=True)]


def text(folder, name, head, lines, encoding="utf-8"):
    (folder / name).write_bytes("\n".join([*head, *lines, ""]).encode(encoding))


def read(folder, output):
    """Write the drafted campaign file, fill in the DOFs, and read."""
    words = draft_file(draft(folder)).text
    words = words.replace('output = ["?"]', f"output = {output}").replace('input = ["?"]', 'input = ["9+z"]')
    (folder / "campaign.toml").write_text(words.replace('unit = "?"', 'unit = "m/N"'), encoding="utf-8")
    (configuration,) = read_campaign(folder / "campaign.toml").configurations
    return read_measurement(read_campaign(folder / "campaign.toml"), configuration.name).frf


def test_headers_of_several_lengths_and_encodings_are_one_set(tmp_path):
    title = "Frequency\tReal\tImag"
    text(tmp_path, "a1.txt", [title], rows())
    text(tmp_path, "a2.txt", ["Title\tM4", "Date\t15/11/2018", "", "Unit\t(m/s²)/N", title], rows(2), "latin-1")
    text(tmp_path, "a3.txt", ["Title\tsecond day", title], rows(3))
    assert draft(tmp_path).left_out == ()
    frf = read(tmp_path, '["1+z", "2+z", "3+z"]')
    np.testing.assert_allclose(frf.value[:, 0], VALUE * np.array([1, 2, 3])[:, None])


def test_headers_of_labviews_text_of_several_lengths_are_one_set(tmp_path):
    for k, more in enumerate(([], ["Project\tplate"]), start=1):
        head = ["LabVIEW Measurement", *more, "***End_of_Header***", "", "Channels\t2", "Samples\t40\t40",
                "X0\t0\t0", "***End_of_Header***", "X_Value\tReal\tImag"]  # fmt: skip
        text(tmp_path, f"a{k}.lvm", head, rows(k))
    frf = read(tmp_path, '["1+z", "2+z"]')
    np.testing.assert_allclose(frf.value[:, 0], VALUE * np.array([1, 2])[:, None])


def test_units_of_several_files_are_asked_for_though_their_encodings_differ(tmp_path):
    text(tmp_path, "a1.txt", ["Unit\t(m/s²)/N"], rows(), "latin-1")
    text(tmp_path, "a2.txt", ["Unit\tV/N"], rows())
    drafted = draft(tmp_path)
    assert drafted.left_out == ()
    assert any("several units" in line for line in draft_file(drafted).missing)


def test_a_row_that_is_off_is_named(tmp_path):
    lines = rows()
    lines[2] = lines[2].replace("\t", "\t\t", 1)
    text(tmp_path, "a1.txt", ["Frequency\tReal\tImag"], rows())
    text(tmp_path, "a2.txt", ["Frequency\tReal\tImag"], lines)
    (said,) = draft(tmp_path).left_out
    assert "a2.txt: row 4 has other cells than the 3 numbers" in said


@pytest.mark.parametrize(("name", "taken"), [("M22_MAGNET", True), ("imaging1", True), ("H1_mag", False)])
def test_a_name_that_only_begins_like_a_part_is_none(tmp_path, name, taken):
    text(tmp_path, f"{name}.txt", [], rows())
    assert (guess_table(tmp_path / f"{name}.txt") is not None) == taken


def of_testlab(label, info="Data saved by Testlab in MKS"):
    quantity = {"label": label, "info": info}
    axis = {"start_value": 0.5, "increment": 0.5, "number_of_values": 40.0}
    return {"FRF": {"x_values": axis, "y_values": {"values": VALUE, "quantity": quantity}}}


def test_testlabs_label_is_read_and_its_numbers_are_in_si(tmp_path):
    savemat(tmp_path / "a.mat", of_testlab("g/N"))
    (contents,) = draft(tmp_path).contents
    assert contents.unit == "m/s2/N"


def test_testlabs_transmissibility_is_refused(tmp_path):
    savemat(tmp_path / "a.mat", of_testlab("/"))
    with pytest.raises(CampaignError, match=r"'/' of 'FRF\.y_values\.values', which is no response over a force"):
        draft(tmp_path)


def test_a_workspace_with_an_object_is_read(tmp_path, monkeypatch):
    savemat(tmp_path / "a.mat", {"H": VALUE, "data": {"f": LINES}})

    def stumble(*_, **__):
        raise TypeError  # as scipy does at an object of MATLAB's

    monkeypatch.setattr("scipy.io.whosmat", stumble)
    with arrays_in(tmp_path / "a.mat", matlab=True) as held:
        assert {name: array.read().size for name, array in held.items()} == {"H": 40, "data.f": 40}


def test_a_record_of_other_channels_than_most_is_left_out(tmp_path):
    times = 0.02 * np.arange(40)
    for name, n in (("calibration", 2), ("set1", 3), ("set2", 3), ("set3", 3)):
        channels = [f"CH{k} [cm/s2]" for k in range(1, n)]
        lines = [f"{t:g},{','.join(f'{np.sin(k * t):g}' for k in range(n))}" for t in times]
        text(tmp_path, f"{name}.csv", [",".join(["Time [s]", *channels, "Force [N]"])], lines)
    drafted = draft(tmp_path)
    (said,) = drafted.left_out
    assert "calibration.csv: holds 2 channels, and most files 3" in said
    assert 'response_unit = "cm/s2"' in draft_file(drafted).text
