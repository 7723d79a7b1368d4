"""Universal files: measured functions, points and units in; FRFs and points out. All to SI here.

pyuff reads and writes the sets of points, lines, coordinate systems and units. It is handed data sets that
were cut out and cleaned here: it pairs delimiters by searching the raw bytes, so that a doubled delimiter,
or a data line that ends in ``-1``, would shift every later set.
"""

from __future__ import annotations

import math
import re
import tempfile
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyuff

from ema.io.files import dofs_in, whole
from ema.io.measured_function import KIND_OF_TYPE, Kind, MeasuredFunction, Unit, parse_unit
from ema.io.uff58 import (
    DataSet,
    Record58,
    cut,
    data_sets,
    encoded_frfs,
    geometry_sets,
    mode_sets,
    read_58,
    with_axes_along,
)
from ema.types.errors import MeasurementError
from ema.types.frf import FRF, Geometry, Quantity
from ema.types.modal_model import ModalModel
from lamella_shared import Integers, Reals

Dimension = Literal["frequency", "time"]
_FREQUENCY = {
    "hz": 1.0, "hertz": 1.0, "1/s": 1.0, "1/sec": 1.0, "s-1": 1.0, "cps": 1.0, "cycles/s": 1.0, "cycles/sec": 1.0,
    "khz": 1e3, "rad/s": 0.5 / math.pi, "rad/sec": 0.5 / math.pi, "radian/s": 0.5 / math.pi,
    "radians/s": 0.5 / math.pi, "radians/sec": 0.5 / math.pi, "rpm": 1.0 / 60.0, "rev/min": 1.0 / 60.0,
    "1/min": 1.0 / 60.0, "cpm": 1.0 / 60.0,
}  # fmt: skip
_TIME = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "millisecond": 1e-3,
    "milliseconds": 1e-3, "us": 1e-6, "usec": 1e-6, "microsecond": 1e-6, "microseconds": 1e-6, "ns": 1e-9,
    "min": 60.0, "minute": 60.0, "minutes": 60.0,
}  # fmt: skip
_BY_CASE = {"MHz": 1e6, "mHz": 1e-3}  # which letters of one size cannot tell apart
_NONE = ("", "none", "unknown", "-")


def abscissa_factor(label: str, dimension: Dimension, where: str) -> float:
    """Return what makes Hz (s) of an abscissa of frequencies (times) with this unit label; 1 without a label.

    Parameters
    ----------
    label : str
        Field "abscissa units label".
    dimension : {"frequency", "time"}
        What the abscissa of such a function is.
    where : str
        File and data set, for the message.

    Raises
    ------
    MeasurementError
        The label is none of a unit of that dimension.
    """
    text = re.sub(r"[\s()\[\]^]", "", label).replace("µ", "u").replace("μ", "u")
    known = _FREQUENCY if dimension == "frequency" else _TIME
    if text.lower() in _NONE:
        return 1.0
    if dimension == "frequency" and text in _BY_CASE:
        return _BY_CASE[text]
    factor = known.get(text.lower())
    if factor is None:
        right = "Hz, kHz, rad/s or rpm" if dimension == "frequency" else "s, ms, us or min"
        raise MeasurementError(
            f"{where}: field 'abscissa units label' is {label!r}, which is no unit of a {dimension}; expected {right}: "
            "export the function with one of them"
        )
    return factor


def is_frequency(code: int, label: str) -> bool:
    """Whether the data type of an abscissa (18), or its unit label where the type is 0 or 1, is a frequency."""
    text = re.sub(r"[\s()\[\]^]", "", label)
    return code == 18 or (code in (0, 1) and (text in _BY_CASE or text.lower() in _FREQUENCY))


_GEOMETRY_SETS = ("15", "18", "82", "164", "2411", "2412", "2420")
OF_GEOMETRY = frozenset((*_GEOMETRY_SETS, "151"))
"""Data sets of points and what is drawn of them, with units and header (151)."""
_MOTION_TYPES: dict[int, Quantity] = {8: "receptance", 11: "mobility", 12: "accelerance"}
_FORCE_TYPES = (9, 13)
_LARGEST = 1e10  # point numbers have ten digits
UNSTATED = (
    "neither a unit label nor data set 164 states its unit, which is taken as SI; say [measurement] unit = 'g/N', or "
    "what it is, in the campaign file"
)
"""What a note says of a unit that nobody stated, after the file and the data set."""
OF_DATA_TYPE = "that of its data type is taken; if it is another, say [measurement] unit in the campaign file"
"""What a note says of a unit label that is not understood, behind it."""
REAL = "its values are real, and those of an FRF are complex: it holds magnitudes or one part alone; it is not used"
"""What a note says of an FRF without its other part, after the file and the data set."""
NOT_OVER_FORCE = "it is no response over a force but"
"""What a note says of a ratio of other things, after the file and the data set and before what it is."""
VOLTS = "its unit is one of volts, without the sensitivity of the sensor:"
"""What a note says of a unit of volts, after the file and the data set and before the unit."""


@dataclass(frozen=True, kw_only=True)
class FileUnits:
    """Length and force unit of a file's values, in m and N, and whether data set 164 stated them."""

    length: float
    force: float
    stated: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class _System:
    """A Cartesian coordinate system: its axes as rows, and its origin, in global coordinates."""

    axes: Reals
    origin: Reals


def read_uff_units(path: Path) -> FileUnits | None:
    """Return the units that data set 164 of a universal file states; None where it has none.

    Raises
    ------
    MeasurementError
        The file cannot be read, or the set is faulty.
    """
    units = _file_units(_parsed([s for s in cut(path, heads=True) if s.kind == "164"]), [])
    return units if units.stated else None


def read_uff_functions(
    path: Path, unit: Unit | None = None, beside: FileUnits | None = None, *, heads: bool = False
) -> tuple[tuple[MeasuredFunction, ...], tuple[str, ...]]:
    """Read every dataset 58 and 58b of a universal file, in SI units.

    The unit labels of a function decide, as the standard says; where they are absent, its data types with
    the factors of data set 164; where both contradict each other the labels are followed and a note says so.

    Parameters
    ----------
    path : Path
        Universal file.
    unit : Unit, optional
        Unit of all FRFs in the file, from a user who knows better than the file.
    beside : FileUnits, optional
        Units of the points' file, for a file that has no data set 164.
    heads : bool
        Whether headers alone are read: the functions then hold one number, 0, in place of their values.

    Returns
    -------
    functions : tuple of MeasuredFunction
    notes : tuple of str
        What was odd in the file and how it was resolved.

    Raises
    ------
    MeasurementError
        The file cannot be read; the message names file, data set and field.
    """
    sets = cut(path, heads=True)
    notes: list[str] = []
    units = _file_units(_parsed([s for s in sets if s.kind == "164"]), notes)
    if beside is not None and not units.stated:
        units = beside
    functions: list[MeasuredFunction] = []
    for data_set in sets if heads else data_sets(path):
        if data_set.kind in ("58", "58b"):
            record = read_58(data_set, head=heads)
            notes += record.notes
            function = _function(record, units, unit, notes)
            if functions and np.array_equal(function.abscissa, functions[-1].abscissa):
                function = replace(function, abscissa=functions[-1].abscissa)  # held once for all
            functions.append(function)
    if not functions:
        raise MeasurementError(f"{path}: no function (dataset 58) in the file; it holds {_listed(sets)}")
    return tuple(functions), tuple(notes)


def read_uff_geometry(path: Path, length_unit: Unit | None = None) -> tuple[Geometry, tuple[str, ...]]:
    """Read points (15, 2411), coordinate systems (18, 2420) and trace lines (82, 2412) of a universal file.

    Parameters
    ----------
    path : Path
        Universal file.
    length_unit : Unit, optional
        Unit of the coordinates, from a user who knows better than data set 164.

    Returns
    -------
    geometry : Geometry
        Coordinates in m; local axes are those of each point's displacement coordinate system.
    notes : tuple of str
        What was odd in the file and how it was resolved.

    Raises
    ------
    MeasurementError
        The file cannot be read, or holds no points; the message names file, data set and field.
    """
    sets = cut(path, heads=True)
    parsed = _parsed([s for s in sets if s.kind in _GEOMETRY_SETS])
    notes: list[str] = []
    units = _file_units(parsed, notes)
    if length_unit is None and not units.stated:
        notes.append(f"{path}: no units (data set 164); coordinates are taken to be in m")
    scale = units.length if length_unit is None else length_unit.factor
    geometry = _points(parsed, scale, f"{path}: no points (15, 2411) in the file; it holds {_listed(sets)}", notes)
    line = _trace_lines(parsed)
    known = np.isin(line, geometry.node).all(axis=1)
    if not known.all():
        absent = sorted({int(n) for n in line[~known].ravel()} - {int(n) for n in geometry.node})
        notes.append(f"{path}: lines to points without coordinates are left out, points {absent[:10]}")
    return replace(geometry, line=line[known]), tuple(notes)


def write_uff(path: Path, geometry: Geometry, frf: FRF | None = None, modal_model: ModalModel | None = None) -> None:
    """Write points, trace lines and, if given, modes and FRFs to a universal file, in SI units.

    Sets 164, 2420 (where points have local axes, or directions off the axes get some), 2411, 82 and for each mode 55
    through pyuff, then a dataset 58b of single precision for each function and its coherence. The file is written
    beside its place and then put there.

    Raises
    ------
    MeasurementError
        The frequency axis is not uniform, so that the format cannot hold it.
    """
    path = Path(path)
    if frf is not None:
        geometry = with_axes_along(geometry, frf.output, frf.input)
    sets = geometry_sets(geometry) + ([] if modal_model is None else mode_sets(modal_model, geometry))
    with whole(path, MeasurementError) as part:
        pyuff.UFF(str(part)).write_sets(sets, mode="overwrite")
        if frf is not None:
            with part.open("ab") as file:
                file.writelines(encoded_frfs(frf, geometry))


def mass_unit(sets: list[DataSet]) -> float:
    """Return the unit of masses of a universal file, kg, by its data set 164; 1 where it has none.

    Raises
    ------
    MeasurementError
        Data set 164 cannot be read.
    """
    units = _file_units(_parsed([s for s in sets if s.kind == "164"]), [])
    return units.force / units.length  # a mass of one is moved by a force of one by a length of one in a second


def _listed(sets: list[DataSet]) -> str:
    return "data sets " + ", ".join(sorted({s.kind for s in sets}))


def _parsed(sets: list[DataSet]) -> list[tuple[str, dict[str, Any]]]:
    """Have pyuff read geometry and unit sets; return each with the name to use in messages."""
    result = []
    with tempfile.TemporaryDirectory() as folder:
        clean = Path(folder) / "clean.uff"
        for data_set in sets:
            clean.write_bytes(b"    -1\n" + data_set.kind_line.rstrip() + b"\n" + _cleaned(data_set) + b"    -1\n")
            try:
                content = pyuff.UFF(str(clean)).read_sets(0)
            except Exception as error:  # pyuff raises bare exceptions
                raise MeasurementError(f"{data_set.where}: {_first_fault(data_set)}") from error
            if "type" not in content:
                raise MeasurementError(f"{data_set.where}: {_first_fault(data_set)}")
            result.append((data_set.where, content))
    return result


def _cleaned(data_set: DataSet) -> bytes:
    """Keep pyuff from taking data for a delimiter, and separate the columns of set 15 that may touch."""
    lines = []
    for line in data_set.body.replace(b"\r", b"").splitlines():
        text = line.decode("latin-1")
        if data_set.kind == "15":
            cells = [text[10 * i : 10 * i + 10] for i in range(4)] + [text[13 * i + 40 : 13 * i + 53] for i in range(3)]
            if all(_is_number(cell) for cell in cells):
                text = " " + " ".join(cells)
        lines.append(re.sub("    -1$", "    -1 ", text) + "\n")
    return "".join(lines).encode("ascii", errors="replace")


def _first_fault(data_set: DataSet) -> str:
    """Name the first line with a word that should be a number, or else the set as a whole."""
    labelled = data_set.kind in ("18", "82", "164", "2420")  # these have lines of free text between the numbers
    for row, line in enumerate(data_set.body.splitlines(), start=1):
        words = line.decode("latin-1").split()
        if not labelled and not all(_is_number(word) for word in words):
            return f"line {row} of the set holds {line.decode('latin-1').strip()!r}, which is not numbers only"
    return "its records are incomplete or hold text in place of numbers"


def _is_number(text: str) -> bool:
    try:
        float(text.lower().replace("d", "e"))
    except ValueError:
        return False
    return True


def _file_units(parsed: list[tuple[str, dict[str, Any]]], notes: list[str]) -> FileUnits:
    """Return the units of data set 164, whose factors divide a value of the file to give SI."""
    stated = [(where, content) for where, content in parsed if content["type"] == 164]
    if not stated:
        return FileUnits(length=1.0, force=1.0, stated=False)
    where, content = stated[0]
    length, force = content["length"], content["force"]
    if not (np.isfinite(length) and np.isfinite(force) and length > 0 and force > 0):
        raise MeasurementError(f"{where}: field 'unit factors' must be positive, found length {length}, force {force}")
    factors = {1: (1.0, 1.0), 3: (1.0, 1 / 9.80665), 5: (1e3, 1e3), 6: (1e2, 1e2)}
    expected = factors.get(content["units_code"], (length, force))
    if not np.allclose(expected, (length, force), rtol=1e-3):
        notes.append(
            f"{where}: units code {content['units_code']} contradicts the factors "
            f"(length {length:g}, force {force:g}); the factors are used"
        )
    return FileUnits(length=1.0 / length, force=1.0 / force, stated=True)


def _function(record: Record58, units: FileUnits, unit: Unit | None, notes: list[str]) -> MeasuredFunction:
    header = record.header
    kind = _kind(record, notes)
    output, force_at = (_degree(record, end, notes) for end in ("response", "reference"))
    if any(abs(header[f"{end} direction"]) > 3 for end in ("response", "reference")):
        notes.append(f"{record.where}: a rotation or an unknown direction; it is not used")
        kind = "other"
    if kind == "frf" and not np.iscomplexobj(record.value):
        notes.append(f"{record.where}: {REAL}")
        kind = "other"
    component = "" if header["response name"].upper() == "NONE" else header["response name"]
    quantity: Quantity | None = None
    factor = 1.0
    if kind == "frf" and unit is not None:
        factor, quantity = unit.factor, unit.frf
    elif kind in ("frf", "response"):
        motion = _axis_unit(record, "ordinate numerator", units, notes)
        force = _axis_unit(record, "ordinate denominator", units, notes)
        if kind == "response":
            kind = "force" if motion is not None and motion.is_force else kind
            factor, quantity = (1.0, None) if motion is None else (motion.factor, motion.motion)
        elif motion is not None and motion.frf is not None:
            factor, quantity = motion.factor, motion.frf
        elif (other := _other_ratio(motion, force)) is not None:
            notes.append(f"{record.where}: {NOT_OVER_FORCE} {other}; it is not used")
            kind = "other"
        elif motion is not None and motion.motion is not None:
            denominator = force.factor if force is not None and force.is_force else units.force
            factor, quantity = motion.factor / denominator, motion.motion
    abscissa = record.abscissa
    if kind != "other":
        dimension: Dimension = "frequency" if kind in ("frf", "coherence") else "time"
        abscissa = abscissa * abscissa_factor(header["abscissa units label"], dimension, record.where)
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is for the quality check to say
        value = record.value.real if kind == "coherence" else record.value * factor
    return MeasuredFunction(
        kind=kind,
        abscissa=abscissa,
        value=value,
        quantity=quantity,
        output=output,
        input=force_at,
        source=record.where,
        component=component,
    )


def _other_ratio(numerator: Unit | None, denominator: Unit | None) -> str | None:
    """Say what a ratio is that is stated to be no response over a force; None where it may be an FRF."""
    if numerator is None or denominator is None:
        return None
    if denominator.motion is not None and numerator.motion is not None:
        return "a response over another response (a transmissibility), which has no natural frequencies of its own"
    if denominator.motion is not None and numerator.is_force:
        return "a force over a response (a dynamic stiffness or apparent mass), whose peaks are antiresonances"
    return "a force over a force" if denominator.is_force and numerator.is_force else None


def _kind(record: Record58, notes: list[str]) -> Kind:
    """Return what a function is: its type, or of type 0 (general) what its abscissa and its denominator say."""
    header = record.header
    code = header["function type"]
    if code != 0:
        return KIND_OF_TYPE.get(code, "other")
    label = header["ordinate denominator units label"]
    over_force = header["ordinate denominator specific data type"] in _FORCE_TYPES or _is_force(label)
    frequencies = is_frequency(header["abscissa specific data type"], header["abscissa units label"])
    if frequencies and over_force and np.iscomplexobj(record.value):
        notes.append(
            f"{record.where}: function type 0 (general); it is taken as an FRF, complex over frequencies and a force"
        )
        return "frf"
    return "other"


def _is_force(label: str) -> bool:
    try:
        return parse_unit(label).is_force
    except MeasurementError:
        return False


def _axis_unit(record: Record58, axis: str, units: FileUnits, notes: list[str]) -> Unit | None:
    """Return the unit of an axis from its label, else from its data type with the units of the file."""
    code = record.header[f"{axis} specific data type"]
    label = record.header[f"{axis} units label"]
    from_type = None
    if code in _MOTION_TYPES:
        dimension = {"receptance": 0, "mobility": -1, "accelerance": -2}[_MOTION_TYPES[code]]
        from_type = Unit(factor=units.length, dimension=(1, dimension, 0))
    elif code in _FORCE_TYPES:
        from_type = Unit(factor=units.force, dimension=(0, 0, 1))
    if label.upper() in ("", "NONE"):
        if from_type is not None and not units.stated:
            notes.append(f"{record.where}: {axis}: {UNSTATED}")
        return from_type
    try:
        from_label = parse_unit(label)
    except MeasurementError as error:
        notes.append(f"{record.where}: field '{axis} units label': {error}; {OF_DATA_TYPE}")
        return from_type
    if from_label.volt:
        notes.append(f"{record.where}: {axis}: {VOLTS} {label}")
        return from_label
    single = from_label.frf is None  # a label of the whole FRF says more than the type of its numerator
    if from_type is not None and single and from_type.dimension != from_label.dimension:
        notes.append(f"{record.where}: {axis}: data type {code} contradicts the unit {label!r}; the unit is used")
    return from_label


def _degree(record: Record58, end: str, notes: list[str]) -> tuple[int, int] | None:
    """Return point and direction of an end, "response" or "reference"; where both are 0, what its name says alone."""
    node, direction = record.header[f"{end} node"], record.header[f"{end} direction"]
    if node > 0 and 1 <= abs(direction) <= 3:
        return node, direction
    named = dofs_in(record.header[f"{end} name"]) if node == direction == 0 else []
    if len(named) != 1:
        return None
    notes.append(f"{record.where}: the {end} DOF is taken from its name, {record.header[f'{end} name']!r}")
    return named[0]


def _points(parsed: list[tuple[str, dict[str, Any]]], scale: float, none_found: str, notes: list[str]) -> Geometry:
    systems = _systems(parsed)
    coordinate: dict[int, Reals] = {}
    axes: dict[int, Reals] = {}
    unknown: set[int] = set()
    for where, content in parsed:
        if content["type"] not in (15, 2411):
            continue
        columns = [content[key] for key in ("node_nums", "def_cs", "disp_cs", "x", "y", "z")]
        if len({len(column) for column in columns}) != 1 or not np.all(np.abs(np.array(columns, float)) < _LARGEST):
            raise MeasurementError(f"{where}: the records of the points are incomplete or not finite")
        for label, defined, measured, *xyz in zip(*columns, strict=True):
            node = int(label)
            unknown |= {int(s) for s in (defined, measured) if s and int(s) not in systems}
            system = systems.get(int(defined))
            local = np.array(xyz, float)
            position = local if system is None else local @ system.axes + system.origin
            if node in coordinate and not np.allclose(position, coordinate[node]):
                notes.append(f"{where}: point {node} is given twice with other coordinates; the first ones are kept")
                continue
            coordinate[node] = position
            axes[node] = systems[int(measured)].axes if int(measured) in systems else np.eye(3)
    if not coordinate:
        raise MeasurementError(none_found)
    if unknown:
        notes.append(f"coordinate systems {sorted(unknown)} are used but not defined; taken to be the global one")
    return Geometry(
        node=np.array(list(coordinate)),
        coordinate=np.array(list(coordinate.values())) * scale,
        line=np.empty((0, 2), dtype=np.int64),
        axes=np.array(list(axes.values())),
    )


def _systems(parsed: list[tuple[str, dict[str, Any]]]) -> dict[int, _System]:
    """Return the coordinate systems by label.

    A matrix of set 2420 has the origin as its fourth row, so it multiplies row vectors from the right and
    its first three rows are the local axes in global coordinates.
    """
    systems: dict[int, _System] = {}
    for where, content in parsed:
        if content["type"] == 2420:
            keys = ("CS_sys_labels", "CS_types", "CS_sys_labels")
            matrices = [_floats(matrix) for matrix in content["CS_matrices"]]
            frames = [(matrix[:3], matrix[3]) for matrix in matrices]
        elif content["type"] == 18:
            keys = ("cs_num", "cs_type", "ref_cs_num")
            points = [_floats(content[key]) for key in ("ref_o", "x_point", "xz_point")]
            if not all(np.all(np.abs(p) < 1e30) for p in points):
                raise MeasurementError(f"{where}: the points of the coordinate systems are not finite")
            frames = [(_axes(o, x, xz), o) for o, x, xz in zip(*points, strict=False)]
        else:
            continue
        numbers = [_floats(content[key]) for key in keys]
        if {len(n) for n in numbers} != {len(frames)} or not np.all(np.abs(numbers) < _LARGEST):
            raise MeasurementError(f"{where}: the records of the coordinate systems are incomplete or not finite")
        for (label, kind, reference), (rows, origin) in zip(np.transpose(numbers), frames, strict=True):
            length = np.linalg.norm(rows, axis=1, keepdims=True)
            if kind != 0 or not (np.isfinite(rows).all() and np.all(length > 0)):
                raise MeasurementError(f"{where}: coordinate system {int(label)} is not Cartesian with three axes")
            base = systems.get(int(reference)) if content["type"] == 18 else None
            axes, start = rows / length, origin
            if base is not None:
                axes, start = axes @ base.axes, origin @ base.axes + base.origin
            systems[int(label)] = _System(axes=axes, origin=start)
    return systems


def _floats(value: Any) -> Reals:
    """Return numbers as floats, an integer that is too large for one as an infinite one."""
    try:
        return np.asarray(value, float)
    except OverflowError:
        return np.full(np.shape(value), np.inf)


def _axes(origin: Reals, on_x: Reals, on_xz: Reals) -> Reals:
    """Return axes (not of unit length) from the origin, a point on +x and one in the +xz plane."""
    x = on_x - origin
    y = np.cross(on_xz - origin, x)
    return np.array([x, y, np.cross(x, y)])


def _trace_lines(parsed: list[tuple[str, dict[str, Any]]]) -> Integers:
    """Return the pairs of points joined by trace lines (82) and element edges (2412), once each."""
    pairs: list[tuple[int, int]] = []
    for where, content in parsed:
        if content["type"] == 82:
            values = np.asarray(content["nodes"], float)
            if not np.all(np.abs(values) < _LARGEST):  # also where it is not a number
                raise MeasurementError(
                    f"{where}: field 'nodes defining trace line' holds values that are no point numbers"
                )
            nodes = values.astype(int).tolist()
            pairs += [(a, b) for a, b in pairwise(nodes) if a > 0 and b > 0]
        elif content["type"] == 2412:
            for elements in (value for value in content.values() if isinstance(value, list)):
                for element in elements:
                    nodes = [int(n) for n in element["nodes_nums"]]
                    if any(abs(n) >= _LARGEST for n in nodes):
                        raise MeasurementError(f"{where}: an element has nodes that are no point numbers")
                    pairs += zip(nodes, nodes[1:] + nodes[:1] if len(nodes) > 2 else nodes[1:], strict=False)
    once = dict.fromkeys((min(pair), max(pair)) for pair in pairs if pair[0] != pair[1])
    return np.array(list(once), dtype=np.int64).reshape(-1, 2)
