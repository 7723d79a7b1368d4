"""Universal files of real test systems, with the oddities that they have."""

from pathlib import Path

import numpy as np
import pytest

from ema.io.measured_function import parse_unit
from ema.io.table import TableLayout, read_table
from ema.io.uff import read_uff_functions, read_uff_geometry
from ema.types.errors import MeasurementError

REALDATA = Path(__file__).parents[2].parent / "shared/realdata"
FOLDER = REALDATA / "uff-oddities-pyuff"
pytestmark = pytest.mark.skipif(not REALDATA.exists(), reason=f"real measurements are not at {REALDATA}")


def one(name):
    functions, notes = read_uff_functions(FOLDER / name)
    assert len(functions) == 1
    return functions[0], notes


def test_every_file_loads_or_says_what_it_lacks():
    files = sorted(REALDATA.rglob("*.uff"))
    lacking = dict.fromkeys(files, 0)
    for file in files:
        for read in (read_uff_functions, read_uff_geometry):
            try:
                read(file)
            except MeasurementError as error:
                lacking[file] += f"{file}: no " in str(error) and "it holds data sets" in str(error)
    # four files hold modes (55) or qualifiers (1858) only; beam.uff alone holds both points and functions
    assert sorted(lacking.values()) == [0] + [1] * 11 + [2] * 4


def test_latin_1_unit_with_doubled_delimiter():
    function, notes = one("non_ascii_header.uff")
    assert function.quantity == "accelerance"
    assert function.output is None  # point 0, direction 0
    np.testing.assert_allclose(function.abscissa, 0.195313 * np.arange(6))
    assert function.value[0] == pytest.approx(0.407994)
    assert notes == ()


def test_utf_8_unit_and_padded_last_line():
    function, notes = one("time-history-not-all-columns-filled.uff")
    assert (function.kind, function.quantity, function.value.size) == ("response", "accelerance", 13)
    assert function.value[-1] == -5.84096
    assert notes == ()


def test_double_precision_binary_in_g():
    function, notes = one("binary8byte.uff")
    assert function.kind == "response"
    np.testing.assert_allclose(function.value[1], 9.80665 * 0.309017, rtol=1e-5)
    np.testing.assert_allclose(function.abscissa[-1], 2.49)
    assert notes == ()


def test_single_precision_binary():
    function, notes = one("Sample_UFF58b_bin.uff")
    assert function.value.size == 79292
    assert notes == ()


def test_wrong_count_and_text_like_a_delimiter():
    function, notes = one("dataset_milestone_in_header.uff")
    assert function.value.size == 42
    assert function.abscissa[0] == pytest.approx(1.11858e-5)
    assert function.input is None  # point -1
    assert "announces 2508876 values, the data hold 42" in notes[0]


def test_uneven_complex_spectrum_is_read_but_is_no_frf():
    function, _ = one("sample_dataset58_psd.uff")
    assert (function.kind, function.value.size) == ("other", 3201)
    assert function.value[3] == pytest.approx(3.803099e-06)


@pytest.mark.parametrize(
    ("name", "n_node", "n_line", "size", "said"),
    [
        ("TestLab 161 164 18 15 82.uff", 36, 30, 8.4, ""),
        ("Artemis export - Geometry RPBC_setup_05_14102016_105117.uff", 74, 162, 5.616, "taken to be in m"),
        ("mesh_Oros-modal_uff15_uff2412.uff", 96, 168, 83.25, "taken to be in m"),
        ("heat_engine_housing.uff", 10, 21, 0.17117556762695, ""),
    ],
)
def test_geometry(name, n_node, n_line, size, said):
    geometry, notes = read_uff_geometry(FOLDER / name)
    assert geometry.node.size == n_node
    assert geometry.line.shape == (n_line, 2)
    np.testing.assert_allclose(np.abs(geometry.coordinate).max(), size)
    assert said in "".join(notes)


def test_length_unit_from_the_user():
    geometry, notes = read_uff_geometry(FOLDER / "mesh_Oros-modal_uff15_uff2412.uff", parse_unit("mm"))
    np.testing.assert_allclose(np.abs(geometry.coordinate).max(), 0.08325)
    assert notes == ()


def test_local_axes_of_data_set_18():
    geometry, _ = read_uff_geometry(FOLDER / "TestLab 161 164 18 15 82.uff")
    # system 7: origin, a point above it, a point on the -y side: local x is global z, local z is global -y
    np.testing.assert_allclose(geometry.direction(7, 1), [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(geometry.direction(7, 3), [0, -1, 0], atol=1e-6)
    np.testing.assert_allclose(geometry.direction(7, -2), np.cross([0, 0, 1], [0, -1, 0]), atol=1e-6)


def test_hammer_rove_in_one_file():
    functions, _ = read_uff_functions(REALDATA / "beam-uff-pyuff/measurement.uff")
    assert [f.output for f in functions] == [(1, 1)] * 3
    assert [f.input for f in functions] == [(1, 1), (2, 1), (3, 1)]


@pytest.mark.parametrize(
    "name",
    [
        "impact-repeats-pyfrf/measurements_1.npy",
        "building-3storey-iqs/experimental_building_frf.zip",
        "ruler-freefree-pydvma/ruler_grid_acc_3.mat",
    ],
)
def test_files_of_other_formats_say_what_to_do(name):
    with pytest.raises(MeasurementError, match="not a universal file") as error:
        read_uff_functions(REALDATA / name)
    assert name in str(error.value)
    with pytest.raises(MeasurementError, match=r"convert binary files \(MATLAB, NumPy, zip\) to CSV") as error:
        read_table(REALDATA / name, TableLayout(layout="real-imaginary"), None)
    assert name in str(error.value)
