"""Tables of text in the layouts that test systems export."""

import gzip

import numpy as np
import pytest
from pydantic import ValidationError

from ema.io.measured_function import parse_unit
from ema.io.table import TableLayout, read_points, read_table
from ema.types.errors import MeasurementError

FREQUENCY = np.array([10.0, 10.5, 11.0])
VALUE = np.array([[1 + 2j, -3 + 0.5j, 2 - 2j], [0.1 - 4j, 5 + 1j, -2 - 1j]])
ACCELERANCE = parse_unit("m/s2/N")


def rows(columns, delimiter=",", decimal="."):
    lines = (delimiter.join(f"{x:.15g}".replace(".", decimal) for x in row) for row in zip(*columns, strict=True))
    return "\n".join(lines) + "\n"


def read(tmp_path, text, unit=ACCELERANCE, name="a.csv", **layout):
    (tmp_path / name).write_text(text, encoding=layout.get("encoding", "utf-8"))
    return read_table(tmp_path / name, TableLayout(**layout), unit)


PARTS = [FREQUENCY, *(part for v in VALUE for part in (v.real, v.imag))]
POLAR = [FREQUENCY, *(part for v in VALUE for part in (np.abs(v), np.angle(v)))]
DECIBEL = [FREQUENCY, *(part for v in VALUE for part in (20 * np.log10(np.abs(v)), np.rad2deg(np.angle(v))))]


@pytest.mark.parametrize(
    ("text", "layout"),
    [
        (rows(PARTS), {"layout": "real-imaginary"}),
        ("x\n" + rows(PARTS), {"layout": "real-imaginary"}),
        (rows(PARTS, ";", ","), {"layout": "real-imaginary", "delimiter": "semicolon", "decimal": ","}),
        ("Spektrum m/s²\nHz\tRe\n" + rows(PARTS, "\t"),
         {"layout": "real-imaginary", "delimiter": "tab", "header_rows": 2, "encoding": "latin-1"}),
        (rows(POLAR, "  "), {"layout": "magnitude-phase", "delimiter": "space", "phase_unit": "rad"}),
        (rows(DECIBEL), {"layout": "magnitude-phase", "magnitude_unit": "dB"}),
        (rows(PARTS).replace("\n", ",\n"), {"layout": "real-imaginary"}),
    ],
)  # fmt: skip
def test_layouts(tmp_path, text, layout):
    functions = read(tmp_path, text, **layout)
    assert len(functions) == 2
    for function, value in zip(functions, VALUE, strict=True):
        np.testing.assert_allclose(function.abscissa, FREQUENCY)
        np.testing.assert_allclose(function.value, value, rtol=1e-12)
        assert function.quantity == "accelerance"
        assert function.output is None


@pytest.mark.parametrize("spelling", ["({:g}{:+g}j)", "{:g}{:+g}i", "{:g} {:+g}J"])
def test_complex_text_without_a_axis_column(tmp_path, spelling):
    text = "\n".join(spelling.format(v.real, v.imag) for v in VALUE[0])
    layout = {"layout": "complex", "axis_column": 0, "axis_start": 10, "axis_step": 0.5}
    (function,) = read(tmp_path, text, **layout)
    np.testing.assert_allclose(function.abscissa, FREQUENCY)
    np.testing.assert_allclose(function.value, VALUE[0])


def test_columns_can_be_named_and_coherence_taken(tmp_path):
    table = rows([*PARTS, [0.9, 0.8, 0.7]])
    functions = read(
        tmp_path, table, layout="real-imaginary", columns=[[4, 5]], coherence_columns=[6], unit=parse_unit("g/N")
    )
    assert [f.kind for f in functions] == ["frf", "coherence"]
    np.testing.assert_allclose(functions[0].value, 9.80665 * VALUE[1])
    np.testing.assert_allclose(functions[1].value, [0.9, 0.8, 0.7])


def test_words_below_the_numbers_are_no_rows_but_words_amid_them_are_faults(tmp_path):
    table = rows(PARTS)
    below = read(tmp_path, table + "TagsBegin:\nTitle,1\n\nTagsEnd:\n", layout="real-imaginary")
    np.testing.assert_allclose(below[1].value, VALUE[1])
    with pytest.raises(MeasurementError, match="row 4, column 1: expected a number, found 'Tags:'"):
        read(tmp_path, f"{table}Tags:\n{table}", layout="real-imaginary")


def test_gzip(tmp_path):
    (tmp_path / "a.txt.gz").write_bytes(gzip.compress(rows(PARTS).encode()))
    functions = read_table(tmp_path / "a.txt.gz", TableLayout(layout="real-imaginary"), ACCELERANCE)
    np.testing.assert_allclose(functions[1].value, VALUE[1])


@pytest.mark.parametrize(
    ("text", "layout", "said"),
    [
        (rows(PARTS).replace("10.5", "ten"), {}, "row 2, column 1: expected a number, found 'ten'"),
        (rows(PARTS) + "12,1\n", {"header_rows": 0}, "row 4, column 3: expected a number, found ''"),
        (rows(PARTS, ";"), {}, "is the delimiter 'comma' right"),
        (rows(PARTS), {"columns": [[8, 9]]}, "column 9 is asked for, but row 1 has 5 columns"),
        (rows(PARTS), {"decimal": ","}, "the comma cannot be both delimiter and decimal mark where numbers"),
        ("", {}, "no rows of numbers"),
        ("1,2,3\n3,2,3\n2,2,3\n", {}, "row 3, column 1: the frequency does not ascend"),
    ],
)
def test_faults_are_named(tmp_path, text, layout, said):
    with pytest.raises(MeasurementError, match=said):
        read(tmp_path, text, layout="real-imaginary", **layout)


@pytest.mark.parametrize(
    "layout", [{"layout": "complex", "columns": [[2, 3]]}, {"layout": "complex", "axis_column": 0}, {"layout": "polar"}]
)
def test_impossible_layouts_are_refused(layout):
    with pytest.raises(ValidationError):
        TableLayout(**layout)


def test_points(tmp_path):
    (tmp_path / "p.csv").write_text("name;X;y;z;node\na;1,5;2;3;7\n\nb;4;5;6;3\n")
    geometry = read_points(tmp_path / "p.csv", parse_unit("mm"))
    np.testing.assert_array_equal(geometry.node, [7, 3])
    np.testing.assert_allclose(geometry.coordinate, [[1.5e-3, 2e-3, 3e-3], [4e-3, 5e-3, 6e-3]])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("node,x,y\n1,2,3\n", "missing: z"),
        ("node,x,y,z\n1,2,3,four\n", "row 2: expected a point number"),
        (f"node,x,y,z\n{'9' * 25},2,3,4\n", "row 2: expected a point number"),
        ("node,x,y,z\n1,2,3,4\n1,2,3,4\n", "row 3: point 1 is given twice"),
        ("node,x,y,z\n", "no points"),
    ],
)
def test_faulty_points_are_named(tmp_path, text, said):
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(MeasurementError, match=said):
        read_points(tmp_path / "p.csv", parse_unit("mm"))
