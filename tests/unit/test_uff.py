"""Universal files: what is written is read back, what is odd is resolved and said, what is wrong is named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema.io.uff import read_uff_functions, read_uff_geometry, write_uff
from ema.types.errors import MeasurementError
from ema.types.frf import FRF, Dofs, Geometry

HEADER = """    -1
    58
NONE
NONE
NONE
NONE
NONE
    4         0    0         0 NONE               {node}   3 NONE              45   3
         {ordinate}         {count}         {spacing}{start:13.5e}{step:13.5e}  0.00000E+00
        18    0    0    0 Frequency            Hz
        {numerator:2d}    0    0    0 Response             {label}
        13    0    0    0 Force                {force}
         0    0    0    0 NONE                 NONE
{body}
    -1
"""


def function(body, node=1, ordinate=5, count=3, spacing=1, start=0.0, step=0.5, numerator=12, label="m/s^2", force="N"):
    return HEADER.format(**locals())


def read(tmp_path, text, **options):
    file = tmp_path / "a.uff"
    file.write_bytes(text if isinstance(text, bytes) else text.encode("latin-1"))
    return read_uff_functions(file, **options)


BODY = "  1.00000E+00  2.00000E+00  3.00000E+00  4.00000E+00  5.00000E+00  6.00000E+00"
VALUE = np.array([1 + 2j, 3 + 4j, 5 + 6j])


@pytest.fixture
def structure():
    rng = np.random.default_rng(1)
    local = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    geometry = Geometry(
        node=[1, 2, 30], coordinate=rng.normal(size=(3, 3)), line=[[1, 2], [2, 30]], axes=[np.eye(3), np.eye(3), local]
    )
    frf = FRF(
        frequency=20 + 0.3 * np.arange(500),
        value=rng.normal(size=(3, 2, 500)) + 1j * rng.normal(size=(3, 2, 500)),
        quantity="mobility",
        output=Dofs(node=[1, 2, 30], direction=[[0, 0, 1], [0, -1, 0], local[0]]),
        input=Dofs(node=[1, 45], direction=[[0, 0, 1], [0, 0, -1]]),
        run=[0, 0, 1],
        source=("a", "b", "c"),
        coherence=rng.random((3, 2, 500)),
    )
    return geometry, frf


def test_directions_off_the_axes_get_local_axes(tmp_path, structure):
    """Written after an identification that took minutes, they had ended it with an error."""
    geometry, frf = structure
    slanted, across = np.array([0.0, 0.6, 0.8]), np.array([0.0, -0.8, 0.6])
    output = Dofs(node=[1, 1, 2], direction=[slanted, across, [0, -1, 0]])
    write_uff(
        tmp_path / "a.uff",
        geometry,
        replace(frf, output=output, input=Dofs(node=[1, 45], direction=[-slanted, [0, 0, -1]])),
    )
    functions, _ = read_uff_functions(tmp_path / "a.uff")
    back, _ = read_uff_geometry(tmp_path / "a.uff")
    frfs = [f for f in functions if f.kind == "frf"]
    found = [back.direction(*one) for one in dict.fromkeys(f.output for f in frfs)]
    np.testing.assert_allclose(found, output.direction, atol=1e-12)
    assert np.linalg.det(back.axes[0]) == pytest.approx(1.0)


def test_what_is_written_is_read_back(tmp_path, structure):
    geometry, frf = structure
    write_uff(tmp_path / "a.uff", geometry, frf)
    functions, notes = read_uff_functions(tmp_path / "a.uff")
    back, geometry_notes = read_uff_geometry(tmp_path / "a.uff")
    assert notes == geometry_notes == ()
    np.testing.assert_array_equal(back.node, geometry.node)
    np.testing.assert_allclose(back.coordinate, geometry.coordinate, rtol=1e-15)
    np.testing.assert_allclose(back.axes, geometry.axes, atol=1e-15)
    np.testing.assert_array_equal(back.line, geometry.line)
    assert [f.kind for f in functions] == ["frf", "coherence"] * 6
    assert [f.output for f in functions[::4]] == [(1, 3), (2, -2), (30, 1)]
    assert [f.input for f in functions[:4:2]] == [(1, 3), (45, -3)]
    for k, written in enumerate(frf.value.reshape(6, -1)):
        np.testing.assert_allclose(functions[2 * k].value, written, rtol=1e-6)
        np.testing.assert_allclose(functions[2 * k].abscissa, frf.frequency, rtol=1e-7)
        assert functions[2 * k].quantity == "mobility"
    assert list(tmp_path.iterdir()) == [tmp_path / "a.uff"]


def test_pyuff_reads_what_is_written(tmp_path, structure):
    pyuff = pytest.importorskip("pyuff")
    geometry, frf = structure
    write_uff(tmp_path / "a.uff", geometry, frf)
    file = pyuff.UFF(str(tmp_path / "a.uff"))
    assert file.get_set_types().tolist() == [164, 2420, 2411, 82] + [58] * 12
    np.testing.assert_allclose(file.read_sets(4)["data"], frf.value[0, 0], rtol=1e-6)


def test_directions_that_no_local_axes_have_are_written_as_none(tmp_path, structure):
    geometry, frf = structure
    output = Dofs(node=[1, 1, 30], direction=[[0.0, 0.6, 0.8], [0, 1, 0], frf.output.direction[2]])
    write_uff(tmp_path / "a.uff", geometry, replace(frf, output=output))
    pyuff = pytest.importorskip("pyuff")
    file = pyuff.UFF(str(tmp_path / "a.uff"))
    codes = [file.read_sets(k)["rsp_dir"] for k in np.flatnonzero(file.get_set_types() == 58)]
    assert codes == [0] * 4 + [2] * 4 + [1] * 4


@pytest.mark.parametrize(
    ("numerator", "label", "force", "factor", "quantity"),
    [
        (12, "m/s^2", "N", 1, "accelerance"),
        (12, "NONE", "NONE", 1, "accelerance"),
        (12, "g", "N", 9.80665, "accelerance"),
        (0, "g/N", "NONE", 9.80665, "accelerance"),
        (1, "(1/N)*(m/s²)", "NONE", 1, "accelerance"),
        (11, "mm/s", "N", 1e-3, "mobility"),
        (8, "µm", "kN", 1e-9, "receptance"),
        (12, "m/s", "N", 1, "mobility"),  # label and type disagree: the label is followed
        (0, "V", "V", 1, None),
    ],
)
def test_units(tmp_path, numerator, label, force, factor, quantity):
    functions, notes = read(tmp_path, function(BODY, numerator=numerator, label=label, force=force))
    np.testing.assert_allclose(functions[0].value, factor * VALUE, rtol=1e-12)
    assert functions[0].quantity == quantity
    assert ("contradicts" in "".join(notes)) == ((numerator, label) == (12, "m/s"))


def test_units_of_data_set_164_hold_for_functions_without_labels(tmp_path):
    units = "    -1\n   164\n         5mm (milli newton)             2\n"
    units += "  1.00000000000000000D+03  1.00000000000000000D+03  1.00000000000000000D+00\n"
    units += "  2.73149999999999980D+02\n    -1\n"
    functions, notes = read(tmp_path, units + function(BODY, label="NONE", force="NONE"))
    assert notes == ()
    np.testing.assert_allclose(functions[0].value, VALUE, rtol=1e-12)  # mm over mN
    functions, notes = read(tmp_path, units + function(BODY, label="NONE", force="N"))
    np.testing.assert_allclose(functions[0].value, 1e-3 * VALUE, rtol=1e-12)
    _, notes = read(tmp_path, units.replace("         5", "         1") + function(BODY))
    assert "units code 1 contradicts the factors" in notes[0]


def test_a_byte_order_mark_does_not_shift_the_sets(tmp_path):
    functions, notes = read(tmp_path, b"\xef\xbb\xbf" + (function(BODY) + function(BODY, node=2)).encode())
    assert [f.output for f in functions] == [(1, 3), (2, 3)]
    assert notes == ()


def test_doubled_and_missing_delimiters_do_not_shift_the_sets(tmp_path):
    text = function(BODY, node=1) + "    -1\n" + function(BODY, node=2) + "    -1\n    -1\n" + function(BODY, node=3)
    functions, _ = read(tmp_path, text.removesuffix("    -1\n"))
    assert [f.output for f in functions] == [(1, 3), (2, 3), (3, 3)]
    functions, notes = read(tmp_path, text.removesuffix("    -1\n"))
    assert "not closed" in notes[-1]


def test_numbers_that_touch_are_read_from_their_columns(tmp_path):
    body = " -1.00000E+00 -2.00000E+00-3.00000E+000-4.00000E+000  5.00000E+00  6.00000E+00"
    functions, _ = read(tmp_path, function(body))
    np.testing.assert_allclose(functions[0].value, [-1 - 2j, -3 - 4j, 5 + 6j])


def test_wrong_count_is_said(tmp_path):
    functions, notes = read(tmp_path, function(BODY, count=9))
    np.testing.assert_allclose(functions[0].value, VALUE)
    assert "announces 9 values, the data hold 3" in notes[0]


def test_even_data_stored_as_uneven(tmp_path):
    body = "\n".join(f"{f:13.5e}{v.real:20.12e}{v.imag:20.12e}" for f, v in zip((5, 6, 7), VALUE, strict=True))
    functions, _ = read(tmp_path, function(body, ordinate=6, spacing=0, step=0.0))
    np.testing.assert_allclose(functions[0].abscissa, [5, 6, 7])
    np.testing.assert_allclose(functions[0].value, VALUE)


def binary(block, extra=b"", count=3, order=1):
    head = function("", count=count).encode()
    head = head[: head.rindex(b"\n\n    -1") + 1]
    kind = f"    58b{order:6d}     2          11{len(block):12d}     0     0           0           0".encode()
    return head.replace(b"    58", kind, 1) + block + extra + b"\n    -1\n"


@pytest.mark.parametrize("extra", [b"", b"\r\n", b"\n", b"\0" * 6])
@pytest.mark.parametrize("order", [1, 2])
def test_binary_with_extra_bytes(tmp_path, extra, order):
    block = VALUE.astype(("<c8", ">c8")[order - 1]).tobytes()
    text = binary(block, extra, order=order)
    functions, _ = read(tmp_path, text + text)
    assert len(functions) == 2
    np.testing.assert_allclose(functions[1].value, VALUE)


def test_binary_that_looks_like_a_delimiter(tmp_path):
    block = b"ab\n    -1\ncd" + b"\n    -1\n\n    -1\n" + b"12345678901234567890"[:20]
    block = block[: len(block) // 8 * 8]
    functions, _ = read(tmp_path, binary(block, count=len(block) // 8) * 2)
    assert [f.value.size for f in functions] == [len(block) // 8] * 2


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (
            ("               1   3", "               x   3"),
            "data set 1 .58.: field 'response node' is not a number: 'x'",
        ),
        (("         5         3", "         7         3"), "ordinate data type 7 is not one of 2, 4, 5, 6"),
        (("  3.00000E+00", "  3.000ooE+00"), "data line 1 does not hold numbers"),
        (("  5.00000e-01", "  0.00000e+00"), "field 'abscissa increment' must be positive"),
        (("    58\n", "    59\n"), "no function .dataset 58. in the file; it holds data sets 59"),
    ],
)
def test_faults_are_named(tmp_path, damage, said):
    text = function(BODY)
    assert damage[0] in text
    with pytest.raises(MeasurementError, match=said) as fault:
        read(tmp_path, text.replace(*damage))
    assert str(tmp_path / "a.uff") in str(fault.value)


def test_a_file_without_data_sets(tmp_path):
    with pytest.raises(MeasurementError, match="not a universal file"):
        read(tmp_path, "hello\n")
    with pytest.raises(MeasurementError, match="cannot be read"):
        read_uff_functions(Path(tmp_path / "absent.uff"))


def test_a_coordinate_system_in_another_one(tmp_path):
    # system 1: origin (1, 0, 0), local x along global y, local z along global z; system 2 the same within 1
    frame = "  1.00000E+00  0.00000E+00  0.00000E+00  1.00000E+00  1.00000E+00  0.00000E+00\n"
    frame += "  1.00000E+00  0.00000E+00  1.00000E+00\n"
    systems = f"    -1\n    18\n         1         0         0         8         1\nA\n{frame}"
    systems += f"         2         0         1         8         1\nB\n{frame}    -1\n"
    point = "    -1\n    15\n         7         2         2         8"
    point += "  1.00000E+00  0.00000E+00  0.00000E+00\n"
    point += "         8         1         0         8  1.00000E+00  2.00000E+00  0.00000E+00\n    -1\n"
    (tmp_path / "a.uff").write_text(systems + point)
    geometry, _ = read_uff_geometry(tmp_path / "a.uff")
    np.testing.assert_allclose(geometry.direction(7, 1), [-1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(geometry.direction(7, 3), [0, 0, 1], atol=1e-15)
    # origin of 2 is one along the local x of 1, so (1, 1, 0); the point is one along its own x from there
    np.testing.assert_allclose(geometry.coordinate, [[0, 1, 0], [-1, 1, 0]], atol=1e-15)
    (tmp_path / "a.uff").write_text(systems.replace("         2         0", "         2         1") + point)
    with pytest.raises(MeasurementError, match=r"data set 1 \(18\): coordinate system 2 is not Cartesian"):
        read_uff_geometry(tmp_path / "a.uff")


@pytest.mark.parametrize("kind", [15, 2412])
def test_a_point_number_beyond_ten_digits(tmp_path, kind):
    point, far = "         7         0         0         8  1.0  2.0  3.0\n", "9" * 25
    sets = {15: point, 2412: "         1        21         1         1         8         2\n 0 0 0\n 7 8\n"}
    sets[kind] = sets[kind].replace("         7 " if kind == 15 else " 7 ", f" {far} ")
    text = "".join(f"    -1\n{name:6d}\n{body}    -1\n" for name, body in sets.items())
    (tmp_path / "a.uff").write_text(text)
    with pytest.raises(MeasurementError, match=f"data set . .{kind}.: .* (not finite|no point numbers)"):
        read_uff_geometry(tmp_path / "a.uff")


def test_a_label_of_a_coordinate_system_that_no_float_holds(tmp_path):
    rows = "  1.0 0.0 0.0\n  0.0 1.0 0.0\n  0.0 0.0 1.0\n  0.0 0.0 0.0\n"
    point = f"    -1\n    15\n{7:10d}{0:10d}{0:10d}{8:10d}  1.0 2.0 3.0\n    -1\n"
    (tmp_path / "a.uff").write_text(f"    -1\n  2420\n{1:10d}\nNone\n {'9' * 400} 0 0\nA\n{rows}    -1\n{point}")
    with pytest.raises(MeasurementError, match=r"data set 1 .2420.: the records .* incomplete or not finite"):
        read_uff_geometry(tmp_path / "a.uff")
