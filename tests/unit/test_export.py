"""Modal models for other programs, read back by pyuff and by the standard library."""

import csv
import dataclasses
from pathlib import Path

import numpy as np
import pytest
import pyuff

from ema import (
    identify,
    read_campaign,
    read_measurement,
    synthesized_frf,
    write_modes_csv,
    write_modes_uff,
    write_shapes_csv,
)

CAMPAIGN = Path(__file__).parents[2] / "data/demo_stack/campaign.toml"


@pytest.fixture(scope="module")
def found():
    campaign = read_campaign(CAMPAIGN)
    first_modes = dataclasses.replace(campaign.identification, band=(150.0, 420.0), order=8)
    return next(iter(identify(dataclasses.replace(campaign, identification=first_modes))))


def test_pyuff_reads_the_modes_back(found, tmp_path):
    model = found.modal_model
    write_modes_uff(tmp_path / "modes.uff", model, step=1.0)
    file = pyuff.UFF(str(tmp_path / "modes.uff"))
    kinds = file.get_set_types()
    assert np.count_nonzero(kinds == 55) == model.frequency.size
    modes = [file.read_sets(int(i)) for i in np.flatnonzero(kinds == 55)]
    for r, mode in enumerate(modes):
        assert mode["eig"] == pytest.approx(model.pole[r], rel=1e-5)  # six digits are written
        place = {int(n): k for k, n in enumerate(mode["node_nums"])}
        component = [mode["r3"][place[int(n)]] for n in model.node]
        np.testing.assert_allclose(component, model.shape[:, r], atol=1e-5 * np.abs(model.shape[:, r]).max())


def test_pyuff_reads_the_synthesised_functions_back(found, tmp_path):
    model = found.modal_model
    write_modes_uff(tmp_path / "modes.uff", model, step=1.0)
    file = pyuff.UFF(str(tmp_path / "modes.uff"))
    at = np.flatnonzero(file.get_set_types() == 58)
    assert at.size == model.node.size
    expected = synthesized_frf(model, 1.0, model.quantity)
    function = file.read_sets(int(at[7]))
    assert function["rsp_node"] == model.node[7]
    np.testing.assert_allclose(function["x"], expected.frequency, rtol=1e-9)
    np.testing.assert_allclose(function["data"], expected.value[7, 0], rtol=1e-6)


def test_the_exported_functions_are_those_that_were_measured(found):
    measured = read_measurement(read_campaign(CAMPAIGN), found.modal_model.name).frf.band(*found.modal_model.band)
    step = float(measured.frequency[1] - measured.frequency[0])
    exported = synthesized_frf(found.modal_model, step, "accelerance")
    error = np.linalg.norm(exported.value - measured.value) / np.linalg.norm(measured.value)
    assert error < 0.02  # the noise is 1 %


def test_tables_hold_every_digit(found, tmp_path):
    model = found.modal_model
    write_modes_csv(tmp_path / "modes.csv", model)
    write_shapes_csv(tmp_path / "shapes.csv", model)
    with (tmp_path / "modes.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["frequency_Hz"]) for row in rows] == model.frequency.tolist()
    assert [float(row["damping_std"]) for row in rows] == model.damping_std.tolist()
    assert [row["mass_normalised"] for row in rows] == ["yes" if s else "no" for s in model.scaled]
    with (tmp_path / "shapes.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    shape = [complex(float(row["mode_2_real"]), float(row["mode_2_imag"])) for row in rows]
    assert shape == model.shape[:, 1].tolist()


@pytest.mark.benchmark
@pytest.mark.filterwarnings("ignore")  # those of the peer while it is imported
def test_an_independent_reader_reads_modes_and_functions_back(found, tmp_path, monkeypatch):
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    sdynpy_uff = pytest.importorskip("sdynpy.fileio.sdynpy_uff")
    model = found.modal_model
    write_modes_uff(tmp_path / "modes.uff", model, step=1.0)
    sets = sdynpy_uff.readuff(str(tmp_path / "modes.uff"))
    assert len(sets[55]) == model.frequency.size
    for r, mode in enumerate(sets[55]):
        assert complex(*mode.real_data[:2]) == pytest.approx(model.pole[r], rel=1e-5)
    expected = synthesized_frf(model, 1.0, model.quantity)
    for i, function in enumerate(sets[58]):
        np.testing.assert_allclose(np.ravel(function.ordinate), expected.value[i, 0], rtol=1e-6)
