"""Structure of universal files, dataset 58 (ASCII) and 58b (binary), and data sets that are ready to be written.

Dataset 58 is read and written here and not by pyuff, because pyuff replaces an unreadable integer of the
header by 0 without a word, ends a binary block at the first bytes that look like a delimiter, answers every
fault with one message, and writes a wrong byte count into the header of 58b.
"""

from __future__ import annotations

import codecs
import mmap
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.types.errors import MeasurementError
from ema.types.frf import FRF, Dofs, Geometry, Quantity
from ema.types.modal_model import ModalModel
from lamella_shared import Reals

Content = bytes | mmap.mmap
_HEADER_LINES = 11
_LONGEST_HEADER = 4096  # bytes of these lines, which have 80 columns each
BYTES = {2: 4, 4: 8, 5: 4, 6: 8}
COMPLEX = (5, 6)
# Field widths of the records, each as (width, name, type), after the description of dataset 58.
_Fields = tuple[tuple[int, str, Callable[[str], Any]], ...]
_DOF: _Fields = (
    (5, "function type", int),
    (10, "function number", int),
    (5, "version number", int),
    (10, "load case", int),
    (11, "response name", str),
    (10, "response node", int),
    (4, "response direction", int),
    (11, "reference name", str),
    (10, "reference node", int),
    (4, "reference direction", int),
)
_FORM: _Fields = (
    (10, "ordinate data type", int),
    (10, "number of values", int),
    (10, "abscissa spacing", int),
    (13, "abscissa minimum", float),
    (13, "abscissa increment", float),
    (13, "z-axis value", float),
)
_AXIS: _Fields = (
    (10, "specific data type", int),
    (5, "length exponent", int),
    (5, "force exponent", int),
    (5, "temperature exponent", int),
    (21, "axis label", str),
    (21, "units label", str),
)
_BINARY: _Fields = (
    (7, "kind", str),
    (6, "byte order", int),
    (6, "floating-point format", int),
    (12, "number of ASCII lines", int),
    (12, "number of bytes", int),
)
_AXES = ("abscissa", "ordinate numerator", "ordinate denominator", "z-axis")


@dataclass(frozen=True, eq=False, kw_only=True)
class DataSet:
    """One data set cut out of a universal file.

    Attributes
    ----------
    where : str
        File, number and kind of the data set, for messages.
    kind : str
        "58", "58b", "2411", ...
    kind_line : bytes
        Its first line, which for 58b also describes the binary block.
    body : bytes
        All that follows the first line, without the closing delimiter.
    closed : bool
        Whether a delimiter closed it.
    """

    where: str
    kind: str
    kind_line: bytes
    body: bytes
    closed: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class Record58:
    """Content of a dataset 58 in the units of its file.

    `header` holds "function type", "response node", "response direction", "reference node", "reference
    direction" and, for each axis, entries like "ordinate numerator units label".
    """

    where: str
    header: dict[str, Any]
    abscissa: Reals
    value: NDArray[Any]
    notes: tuple[str, ...]


def cut(path: Path, *, heads: bool = False) -> list[DataSet]:
    """Return what `data_sets` gives, as a list."""
    if not heads:
        return list(data_sets(path))
    try:
        state = path.stat()
    except (OSError, ValueError):
        return list(data_sets(path, heads=True))  # which says what is wrong
    return list(_heads(path, state.st_mtime_ns, state.st_size))


@lru_cache(maxsize=1)
def _heads(path: Path, _mtime: int, _size: int) -> tuple[DataSet, ...]:
    """Return the heads of a file in a state that its time and its size tell; several readers of a draft ask for them.

    `_mtime`, `_size`: of the file, ns and bytes.
    """
    return tuple(data_sets(path, heads=True))


def data_sets(path: Path, *, heads: bool = False) -> Iterator[DataSet]:
    """Cut a universal file into data sets; doubled or missing delimiters do not shift the following sets.

    The file is not held as a whole: each set is copied out of it when it is asked for.

    Parameters
    ----------
    path : Path
        Universal file.
    heads : bool
        Whether functions (58, 58b) come with their headers alone, without their numbers.

    Raises
    ------
    MeasurementError
        The file cannot be read or has no data set.
    """
    data = _content(path)
    n_set = 0
    position = len(codecs.BOM_UTF8) if data[:3] == codecs.BOM_UTF8 else 0  # editors put it before the delimiter
    while position < len(data):
        line, position = _line(data, position)
        if not _is_delimiter(line):
            continue
        while _is_delimiter(line):
            line, position = _line(data, position)
        kind = re.match(rb" *(\d{1,6})([bB]?)", line)
        if kind is None:
            continue
        n_set += 1
        name = (kind[1].lstrip(b"0") + kind[2].lower()).decode()
        where = f"{path}: data set {n_set} ({name})"
        end = _binary_end(data, position, where) if name == "58b" else _text_end(data, position)
        stop = min(end[0], position + _LONGEST_HEADER) if heads and name in ("58", "58b") else end[0]
        body = data[position:stop]
        if isinstance(data, mmap.mmap) and hasattr(data, "madvise"):
            data.madvise(mmap.MADV_DONTNEED)  # pages that were read would count as memory up to the end
        yield DataSet(where=where, kind=name, kind_line=line, body=body, closed=end[1] >= 0)
        position = end[1] if end[1] >= 0 else len(data)
    if n_set == 0:
        raise MeasurementError(f"{path}: not a universal file: no data set between delimiter lines '    -1'")


def _content(path: Path) -> Content:
    """Return a file as bytes that are read where they are looked at."""
    try:
        with path.open("rb") as file:
            if os.fstat(file.fileno()).st_size == 0:
                return b""
            data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            beginning = 400  # bytes in which lines end
            if b"\r" in data[:beginning] and b"\n" not in data[:beginning]:  # lines as old Macintoshes ended them
                return data[:].replace(b"\r", b"\n")
            return data
    except (OSError, ValueError) as error:
        raise MeasurementError(f"{path}: cannot be read: {getattr(error, 'strerror', error)}") from error


def read_58(data_set: DataSet, *, head: bool = False) -> Record58:
    """Read one dataset 58 or 58b; with `head` its header alone, with one number 0 in place of its values.

    Raises
    ------
    MeasurementError
        A field of the header or the data cannot be read; the message names file, data set and field.
    """
    notes = [] if data_set.closed else [f"{data_set.where}: not closed by a delimiter; read to the end of the file"]
    lines, body = _header_lines(data_set.body)
    if len(lines) < _HEADER_LINES:
        raise MeasurementError(f"{data_set.where}: the header has {len(lines)} lines instead of {_HEADER_LINES}")
    header = _fields(lines[5], _DOF, "", data_set.where) | _fields(lines[6], _FORM, "", data_set.where)
    for name, line in zip(_AXES, lines[7:], strict=True):
        header |= _fields(line, _AXIS, f"{name} ", data_set.where)
    ordinate = header["ordinate data type"]
    if ordinate not in BYTES:
        raise MeasurementError(f"{data_set.where}: ordinate data type {ordinate} is not one of 2, 4, 5, 6")
    if head:
        value = np.zeros(1, complex if ordinate in COMPLEX else float)
        return Record58(where=data_set.where, header=header, abscissa=np.zeros(1), value=value, notes=())
    uneven = header["abscissa spacing"] == 0
    per_value = (2 if ordinate in COMPLEX else 1) + (1 if uneven else 0)
    if data_set.kind == "58b":
        numbers = _binary_numbers(data_set, body, header, per_value, notes)
    else:
        numbers = _text_numbers(data_set.where, body, ordinate, uneven)
    count = numbers.size // per_value
    announced = header["number of values"]
    if count < announced or numbers.size - announced * per_value >= 6:
        notes.append(f"{data_set.where}: the header announces {announced} values, the data hold {count}; all are used")
    else:
        count = announced  # what exceeds the count by less than a line fills up the last line
    if count == 0:
        raise MeasurementError(f"{data_set.where}: no data values")
    table = numbers[: count * per_value].reshape(count, per_value)
    abscissa, table = (table[:, 0], table[:, 1:]) if uneven else (_even_abscissa(header, count, data_set), table)
    value = table[:, 0] + 1j * table[:, 1] if ordinate in COMPLEX else table[:, 0]
    return Record58(where=data_set.where, header=header, abscissa=abscissa, value=value, notes=tuple(notes))


def encode_58b(header: dict[str, Any], start: float, step: float, value: NDArray[Any]) -> bytes:
    """Return a dataset 58b with delimiters: little-endian, single precision, even abscissa.

    Parameters
    ----------
    header : dict
        Entries as in `Record58.header`; those that are absent are written as 0 or NONE. "id" may hold up
        to five identification lines.
    start, step : float
        First abscissa and its increment.
    value : (n_value,) float or complex
        Ordinate.
    """
    is_complex = np.iscomplexobj(value)
    block = np.ascontiguousarray(value, dtype="<c8" if is_complex else "<f4").tobytes()
    form = {
        "ordinate data type": 5 if is_complex else 2,
        "number of values": value.size,
        "abscissa spacing": 1,
        "abscissa minimum": start,
        "abscissa increment": step,
    }
    identification = [*header.get("id", ()), *["NONE"] * 5][:5]
    lines = [
        f"{-1:6d}",
        f"{58:6d}b{1:6d}{2:6d}{_HEADER_LINES:12d}{len(block):12d}{0:6d}{0:6d}{0:12d}{0:12d}",
        *(f"{line:<80.80}" for line in identification),
        _record(header, _DOF, ""),
        _record(form, _FORM, ""),
        *(_record(header, _AXIS, f"{name} ") for name in _AXES),
    ]
    return ("\n".join(lines) + "\n").encode() + block + f"{-1:6d}\n".encode()


def _record(values: dict[str, Any], fields: _Fields, prefix: str) -> str:
    text = ""
    for width, name, kind in fields:
        if kind is str:
            text += f" {values.get(prefix + name, 'NONE'):<{width - 1}.{width - 1}}"
        elif kind is float:
            # seven decimals fill the 13 columns; the standard's five misplace a fine frequency axis
            text += f"{values.get(prefix + name, 0.0):{width}.{width - 6}e}"
        else:
            text += f"{values.get(prefix + name, 0):{width}d}"
    return text


def _line(data: Content, position: int) -> tuple[bytes, int]:
    """Return the line that starts at `position` without its end, and where the next one starts."""
    end = data.find(b"\n", position)
    end = len(data) if end < 0 else end
    return data[position:end].rstrip(b"\r"), end + 1


def _is_delimiter(line: bytes) -> bool:
    return line.strip() == b"-1" and len(line.rstrip()) <= 6


_DELIMITER = re.compile(rb"(?:^|\n) {0,4}-1 *\r?(?:\n|\Z)")
_AFTER_BLOCK = re.compile(rb"[\r\n]{0,4} {0,4}-1 *\r?(?:\n|\Z)")


def _text_end(data: Content, position: int) -> tuple[int, int]:
    """Return where the body ends and where the next set may start (-1 without a closing delimiter)."""
    match = _DELIMITER.search(data, max(position - 1, 0))
    return (len(data), -1) if match is None else (max(match.start(), position), match.end())


def _header_lines(data: bytes) -> tuple[list[bytes], bytes]:
    lines: list[bytes] = []
    position = 0
    while len(lines) < _HEADER_LINES and position < len(data):
        line, position = _line(data, position)
        lines.append(line)
    return lines, data[position:]


def _binary_end(data: Content, position: int, where: str) -> tuple[int, int]:
    """Find the end of a 58b by what it announces: its bytes may look like a delimiter."""
    head = data[position : position + _LONGEST_HEADER]
    lines, rest = _header_lines(head)
    start = position + len(head) - len(rest)
    try:
        form = _fields(lines[6], _FORM, "", where)
        size = BYTES[form["ordinate data type"]]
        per_value = (2 if form["ordinate data type"] in COMPLEX else 1) + (form["abscissa spacing"] == 0)
        announced = start + size * per_value * max(form["number of values"], 0)
    except (MeasurementError, KeyError, IndexError):
        announced = start  # the fault is reported when the set itself is read
    # The delimiter may follow the block without a line end. Where it does not follow what is announced, the
    # count is wrong: take the first delimiter behind the header instead.
    end = _AFTER_BLOCK.match(data, min(announced, len(data)))
    return (announced, end.end()) if end is not None else _text_end(data, start)


def _fields(line: bytes, fields: _Fields, prefix: str, where: str) -> dict[str, Any]:
    """Split a record at its fixed columns; blank numbers are 0, as in the standard's fixed format."""
    values: dict[str, Any] = {}
    position = 0
    for width, name, kind in fields:
        text = _decoded(line[position : position + width]).strip()
        position += width
        if kind is float:
            text = text.replace("D", "E").replace("d", "e")  # Fortran's exponents of double precision
        try:
            values[prefix + name] = kind(text or "0") if kind is not str else text
        except ValueError as error:
            raise MeasurementError(f"{where}: field {prefix + name!r} is not a number: {text!r}") from error
    return values


def _decoded(text: bytes) -> str:
    """Decode a label: UTF-8 where it is valid, else Latin-1, which older systems wrote."""
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1")


def _even_abscissa(header: dict[str, Any], count: int, data_set: DataSet) -> Reals:
    step = header["abscissa increment"]
    if not (np.isfinite(step) and step > 0 and np.isfinite(header["abscissa minimum"])):
        raise MeasurementError(
            f"{data_set.where}: field 'abscissa increment' must be positive for even spacing, found {step}"
        )
    return header["abscissa minimum"] + step * np.arange(count)


def _binary_numbers(data_set: DataSet, body: bytes, header: dict[str, Any], per_value: int, notes: list[str]) -> Reals:
    description = _fields(data_set.kind_line, _BINARY, "", data_set.where)
    if description["floating-point format"] not in (0, 2):
        raise MeasurementError(
            f"{data_set.where}: field 'floating-point format' is {description['floating-point format']}; "
            "only IEEE 754 (2) is read"
        )
    size = BYTES[header["ordinate data type"]]
    order = ">" if description["byte order"] == 2 else "<"
    surplus = len(body) - header["number of values"] * per_value * size
    if surplus:
        notes.append(f"{data_set.where}: the binary block is {surplus:+d} bytes off its announced size")
    with np.errstate(invalid="ignore"):  # a bit pattern may be no number; the quality check says so
        return np.frombuffer(body[: len(body) // size * size], dtype=f"{order}f{size}").astype(float)


def _text_numbers(where: str, body: bytes, ordinate: int, uneven: bool) -> Reals:
    """Read the numbers between blanks or, where numbers touch, from the fixed columns of the standard."""
    text = body.replace(b"D", b"E").replace(b"d", b"e")
    numbers = _converted(text.split())
    if numbers is not None:
        return numbers
    widths: tuple[int, ...] = (13,) * 6
    if ordinate in (4, 6):
        widths = (20,) * 4 if not uneven else (13, 20, 13, 20) if ordinate == 4 else (13, 20, 20)
    edges = np.cumsum((0, *widths))
    numbers = _converted(
        [line[start:end] for line in text.splitlines() for start, end in pairwise(edges) if line[start:end].strip()]
    )
    if numbers is None:
        rows = enumerate(text.splitlines(), start=1)
        row, line = next((row, line) for row, line in rows if _converted(line.split()) is None)
        raise MeasurementError(f"{where}: data line {row} does not hold numbers: {_decoded(line).rstrip()!r}")
    return numbers


def _converted(words: list[bytes]) -> Reals | None:
    try:
        return np.array(words, dtype="S").astype(float) if words else np.empty(0)
    except ValueError:
        return None


_ALONG = 1e-6  # that unit vectors may be off each other
LABEL_OF_MOTION: dict[Quantity, str] = {"receptance": "m", "mobility": "m/s", "accelerance": "m/s^2"}
"""Unit of the response whose FRF each is."""


def geometry_sets(geometry: Geometry) -> list[dict[str, Any]]:
    """Return units (164), local axes (2420), points (2411) and trace lines (82) as pyuff takes them."""
    zero = np.zeros(geometry.node.size, dtype=int)
    local = np.flatnonzero(np.abs(geometry.axes - np.eye(3)).max(axis=(1, 2), initial=0.0) > 0)
    system = zero.copy()
    system[local] = 1 + np.arange(local.size)
    x, y, z = geometry.coordinate.T
    sets: list[dict[str, Any]] = [
        {"type": 164, "units_code": 1, "units_description": "SI: Meter (newton)", "temp_mode": 1,
         "length": 1.0, "force": 1.0, "temp": 1.0, "temp_offset": 273.15},
    ]  # fmt: skip
    if local.size:
        matrices = [np.vstack([geometry.axes[i], np.zeros(3)]) for i in local]
        names = [f"point {geometry.node[i]}" for i in local]
        sets.append(
            {"type": 2420, "CS_sys_labels": system[local], "CS_types": zero[local], "CS_colors": zero[local],
             "CS_names": names, "CS_matrices": matrices}
        )  # fmt: skip
    sets.append(
        {"type": 2411, "node_nums": geometry.node, "def_cs": zero, "disp_cs": system, "color": zero,
         "x": x, "y": y, "z": z}
    )  # fmt: skip
    if geometry.line.size:
        nodes = np.column_stack([geometry.line, np.zeros(len(geometry.line), dtype=int)]).ravel()[:-1]
        sets.append({"type": 82, "trace_num": 1, "n_nodes": nodes.size, "color": 0, "id": "lines", "nodes": nodes})
    return sets


def with_axes_along(geometry: Geometry, *dofs: Dofs) -> Geometry:
    """Return points with local axes along the directions in which something is there, where it is off their axes.

    A universal file knows a direction by the axis of its point alone. Where more than three directions meet at a point,
    or some are not at right angles, its axes stay as they are.
    """
    axes = geometry.axes.copy()
    for i, node in enumerate(geometry.node.tolist()):
        directions = np.vstack([there.direction[there.node == node] for there in dofs])
        different: list[Reals] = []
        for direction in directions:
            if all(abs(direction @ other) < 1.0 - _ALONG for other in different):
                different.append(direction)
        is_off = any(_code(geometry, node, direction) == 0 for direction in different)
        if is_off and np.abs(np.triu(np.array(different) @ np.transpose(different), 1)).max() < _ALONG:
            axes[i] = np.linalg.qr(np.transpose(different), mode="complete")[0].T
            axes[i, 2] *= np.sign(np.linalg.det(axes[i]))
    return replace(geometry, axes=axes)


def encoded_frfs(frf: FRF, geometry: Geometry) -> list[bytes]:
    """Return a dataset 58b for each function, followed by that of its coherence where there is one.

    A direction that is not along an axis of its point is written as 0, which stands for none.

    Raises
    ------
    MeasurementError
        The frequency axis is not uniform.
    """
    type_of_motion = {"receptance": 8, "mobility": 11, "accelerance": 12}
    step = np.diff(frf.frequency)
    if step.size == 0 or np.ptp(step) > 1e-6 * step.mean():
        raise MeasurementError("a universal file is written for a uniform frequency axis only; this one is not")
    blocks = []
    for i, source in enumerate(frf.source):
        for j in range(frf.input.node.size):
            header = {
                "id": (f"run {frf.run[i]}", Path(source).name),
                "response node": int(frf.output.node[i]),
                "response direction": _code(geometry, int(frf.output.node[i]), frf.output.direction[i]),
                "reference node": int(frf.input.node[j]),
                "reference direction": _code(geometry, int(frf.input.node[j]), frf.input.direction[j]),
                "abscissa specific data type": 18,
                "abscissa axis label": "Frequency",
                "abscissa units label": "Hz",
            }
            ordinate = {
                "function type": 4,
                "ordinate numerator specific data type": type_of_motion[frf.quantity],
                "ordinate numerator units label": LABEL_OF_MOTION[frf.quantity],
                "ordinate denominator specific data type": 13,
                "ordinate denominator units label": "N",
            }
            start, spacing = float(frf.frequency[0]), float(step.mean())
            blocks.append(encode_58b(header | ordinate, start, spacing, frf.value[i, j]))
            if frf.coherence is not None:
                blocks.append(encode_58b(header | {"function type": 6}, start, spacing, frf.coherence[i, j]))
    return blocks


def mode_sets(modal_model: ModalModel, geometry: Geometry) -> list[dict[str, Any]]:
    """Return a dataset 55 for each mode: complex eigenvalue, modal A and B, shape in the axes of each point.

    A mass-normalised shape has the modal A of 2 i omega_d, so that its residue is shape**2 / A; modal A and B of
    a shape without scale are 0, which stands for unknown.
    """
    node, index = np.unique(modal_model.node, return_inverse=True)
    axes = np.stack([geometry.axes[geometry.node == n][0] if n in geometry.node else np.eye(3) for n in node])
    sets = []
    for r, pole in enumerate(modal_model.free_pole):
        vector = np.zeros((node.size, 3), dtype=complex)
        np.add.at(vector, index, modal_model.direction * modal_model.shape[:, [r]])
        local = np.einsum("nij,nj->ni", axes, vector)
        modal_a = 2j * pole.imag if modal_model.scaled[r] else 0j
        sets.append(
            {"type": 55, "id1": modal_model.name, "id2": f"{modal_model.frequency[r]:.6g} Hz, damping "
             f"{100 * modal_model.damping[r]:.4g} %", "model_type": 1, "analysis_type": 3, "data_ch": 2,
             "spec_data_type": 8, "load_case": 1, "mode_n": r + 1, "eig": pole, "modal_a": modal_a,
             "modal_b": -pole * modal_a, "node_nums": node, "r1": local[:, 0], "r2": local[:, 1], "r3": local[:, 2]}
        )  # fmt: skip
    return sets


def _code(geometry: Geometry, node: int, direction: Reals) -> int:
    codes = (1, 2, 3, -1, -2, -3)
    along = (code for code in codes if np.allclose(geometry.direction(node, code), direction, atol=_ALONG))
    return next(along, 0)
