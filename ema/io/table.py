"""Tables of text: FRFs in the column layouts that test systems export, and lists of points. To SI here."""

from __future__ import annotations

import csv
import gzip
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveInt, model_validator

from ema.io.files import Code, dof_of_cells, from_polar
from ema.io.measured_function import MeasuredFunction, Unit, require_ascending
from ema.io.rows import (
    SEPARATORS,
    Segment,
    cells_of,
    decoded,
    first_row,
    number,
    plain_rows,
    segments_of,
    ungrouped,
    unpacked,
)
from ema.types.errors import MeasurementError
from ema.types.frf import Geometry
from lamella_shared import Integers, Reals, plain_bytes

_BEYOND = "beyond the last column"
_OF_NODE = r"nodes?|points?|punkte?|knoten|to[cč]ka|(?:node|point)[ _]?(?:no|nr|number|id)\.?"
_OF_UNIT = re.compile(r"[\[(](.*?)[\])]")
_LENGTHS = {"m", "cm", "mm", "in"}


class TableLayout(BaseModel):
    """How the columns of a text file hold measured functions; keys of ``[measurement.table]``.

    Attributes
    ----------
    layout : {"real-imaginary", "magnitude-phase", "complex", "time"}
        Two columns for each FRF, or one of complex numbers written like ``(1.2-3.4j)`` or ``1.2-3.4i``, or
        one for each time history.
    delimiter : {"comma", "semicolon", "tab", "space"}
        What separates the columns; "space" is any amount of blanks and tabs.
    decimal : {".", ","}
        Decimal mark.
    header_rows : int
        Rows before the first row of numbers; of files with headers of several lengths those of the shortest, for
        further rows of a header are seen.
    encoding : str
        Text encoding of the header.
    axis_column : int
        Column of the frequency in Hz or the time in s, counted from 1; 0 when there is none.
    axis_start, axis_step : float
        First value and step (Hz or s) of a file without such a column.
    sampling_Hz : float or None
        Sampling rate of time histories, Hz, where times are missing or rounded.
    columns : tuple of tuple of int
        Columns of each function, e.g. ``[[2, 3], [6, 7]]``; empty takes all columns but the axis.
    coherence_columns : tuple of int
        Column of each function's coherence, in the order of the functions; may be empty.
    phase_unit : {"deg", "rad"}
        Unit of the phase.
    magnitude_unit : {"linear", "dB"}
        "dB" is 20 log10 of the magnitude over one of its unit.
    output_columns, input_columns : tuple of int
        Columns that state the DOF of each row where functions stand below each other: one of ``12+z``, or one of the
        point and one of the direction. Rows with the same cells are one function.
    direction : str
        Direction of a point that stands there alone, such as ``+z``.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    layout: Literal["real-imaginary", "magnitude-phase", "complex", "time"]
    delimiter: Literal["comma", "semicolon", "tab", "space"] = "comma"
    decimal: Literal[".", ","] = "."
    header_rows: int = Field(default=0, ge=0)
    encoding: str = "utf-8"
    axis_column: int = Field(default=1, ge=0)
    axis_start: float = 0.0
    axis_step: float = Field(default=0.0, ge=0)
    sampling_Hz: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    columns: tuple[tuple[PositiveInt, ...], ...] = ()
    coherence_columns: tuple[PositiveInt, ...] = ()
    phase_unit: Literal["deg", "rad"] = "deg"
    magnitude_unit: Literal["linear", "dB"] = "linear"
    output_columns: tuple[PositiveInt, ...] = Field(default=(), max_length=2)
    input_columns: tuple[PositiveInt, ...] = Field(default=(), max_length=2)
    direction: str = Field(default="", pattern="^([+-][xyz])?$")

    @property
    def width(self) -> int:
        """Number of columns of one function."""
        return 2 if self.layout in ("real-imaginary", "magnitude-phase") else 1

    @model_validator(mode="after")
    def _consistent(self) -> TableLayout:
        width = self.width
        if any(len(columns) != width for columns in self.columns):
            raise ValueError(f"layout {self.layout!r} takes {width} column(s) for each function in 'columns'")
        if self.sampling_Hz is not None and self.layout != "time":
            raise ValueError("sampling_Hz is of time histories, layout = 'time'")
        if self.axis_column == 0 and self.axis_step <= 0 and self.sampling_Hz is None:
            raise ValueError(
                "without a column of the frequency or time (axis_column = 0), axis_step must be positive, or state "
                "the sampling rate of time histories as sampling_Hz"
            )
        if (self.output_columns or self.input_columns) and self.layout == "time":
            raise ValueError("output_columns and input_columns are of FRFs, not of time histories")
        return self


def read_table(path: Path, layout: TableLayout, unit: Unit | None) -> tuple[MeasuredFunction, ...]:
    """Read every function of a text table, plain or gzip-compressed (``.gz``).

    FRFs of `unit` come in SI units. Time histories come as they stand, as functions of kind "response",
    since only the user knows which column is the force; of several records, see `read_records`, those of the first.
    Tables state no degrees of freedom, so `output` and `input` of the functions are None, but those with a row for
    each number of each degree of freedom.

    Raises
    ------
    MeasurementError
        The file cannot be read as `layout` describes it; the message names file, row and column.
    """
    records = read_records(path, layout, unit)
    return records[0] if layout.layout == "time" else tuple(f for record in records for f in record)


def read_records(
    path: Path, layout: TableLayout, unit: Unit | None = None, *, same_start: float = 0.5
) -> tuple[tuple[MeasuredFunction, ...], ...]:
    """Read every record of a text table, each with its functions: one, and of LabVIEW's text one for each segment.

    A segment that begins where the one before ends goes on with it.

    `same_start`: share of a step, where a segment begins that goes on with the one before.

    Raises
    ------
    MeasurementError
        As `read_table`.
    """
    rows = _text(path, layout.encoding).splitlines()
    _require_quotes(path, layout, rows)
    records: list[tuple[MeasuredFunction, ...]] = []
    end = None
    first = first_row(rows, layout.header_rows)
    heads = frozenset(filter(None, (row.strip() for row in rows[:first])))
    for segment in segments_of(rows, first):
        functions = _record(path, layout, segment, heads, unit)
        step = float(np.diff(functions[0].abscissa).mean()) if functions[0].abscissa.size > 1 else 0.0
        goes_on = end is not None and abs(segment.start - end) < same_start * step and layout.layout == "time"
        if goes_on and len(functions) == len(records[-1]):
            records[-1] = tuple(_joined(a, b, step) for a, b in zip(records[-1], functions, strict=True))
        else:
            records.append(functions)
        end = segment.start + step * functions[0].abscissa.size
    if not records:
        raise MeasurementError(f"{path}: no rows of numbers after {layout.header_rows} header rows")
    return tuple(records)


def _joined(first: MeasuredFunction, second: MeasuredFunction, step: float) -> MeasuredFunction:
    """Return a time history that goes on in the next segment."""
    count = second.abscissa.size
    after = first.abscissa[-1] + step * np.arange(1, count + 1)
    return replace(first, abscissa=np.append(first.abscissa, after), value=np.append(first.value, second.value))


def _require_quotes(path: Path, layout: TableLayout, rows: list[str]) -> None:
    """Refuse commas between columns and in numbers, which nothing tells apart but quotes."""
    both = layout.decimal == "," and layout.delimiter == "comma"
    if both and not any('"' in row for row in rows[layout.header_rows :]):
        raise MeasurementError(
            f"{path}: the comma cannot be both delimiter and decimal mark where numbers do not stand in quotes"
        )


def _record(
    path: Path, layout: TableLayout, segment: Segment, heads: frozenset[str], unit: Unit | None
) -> tuple[MeasuredFunction, ...]:
    """Return the functions of the rows of one segment, in which rows of the header may come again on every page."""
    rows = _rows(path, layout, [row for row in segment.rows if row.strip() not in heads])
    width = len(cells_of(rows[0], layout.delimiter))
    columns = layout.columns or _all_columns(width, layout, path)
    used = [*(c for group in columns for c in group), *layout.coherence_columns]
    beyond = max((*used, *layout.output_columns, *layout.input_columns, layout.axis_column))
    if layout.axis_column:
        used.append(layout.axis_column)
    if beyond > width:
        raise MeasurementError(f"{path}: column {beyond} is asked for, but row {segment.first + 1} has {width} columns")
    _require_width(path, rows, layout, segment.first)
    table = _numbers(path, rows, layout, sorted(set(used)), segment.first)
    if not layout.output_columns and not layout.input_columns:
        axis = _axis(path, layout, table, np.arange(len(rows)) + segment.first + 1)
        return _functions(path, layout, columns, table, axis, unit)
    functions: list[MeasuredFunction] = []
    for (output, force), at in _rows_of_dofs(path, layout, rows, segment.first).items():
        of_dof = {c: values[at] for c, values in table.items()}
        axis = _axis(path, layout, of_dof, at + segment.first + 1)
        functions += (
            replace(f, output=output, input=force, source=f"{f.source}, from row {at[0] + segment.first + 1} on")
            for f in _functions(path, layout, columns, of_dof, axis, unit)
        )
    return tuple(functions)


def _rows_of_dofs(
    path: Path, layout: TableLayout, rows: list[str], first: int
) -> dict[tuple[Code | None, Code | None], Integers]:
    """Return the rows of each pair of output and input, in their order."""
    found: dict[tuple[str, ...], list[int]] = {}
    split = len(layout.output_columns)
    places = [c - 1 for c in (*layout.output_columns, *layout.input_columns)]
    for k, row in enumerate(rows):
        cells = cells_of(row, layout.delimiter)
        found.setdefault(tuple(cells[c] if c < len(cells) else "" for c in places), []).append(k)
    of_dofs: dict[tuple[Code | None, Code | None], Integers] = {}
    for words, at in found.items():
        ends = []
        for columns, of_end in ((layout.output_columns, words[:split]), (layout.input_columns, words[split:])):
            ends.append(dof_of_cells(of_end, layout.direction) if columns else None)
            if columns and ends[-1] is None:
                raise MeasurementError(
                    f"{path}: row {first + at[0] + 1}, column {', '.join(map(str, columns))}: expected a DOF such as "
                    f"12+z, found {', '.join(map(_shown, of_end))}; state the direction of points alone as direction"
                )
        of_dofs[ends[0], ends[1]] = np.array(at)
    return of_dofs


def _axis(path: Path, layout: TableLayout, table: dict[int, NDArray[Any]], row: Integers) -> Reals:
    """Return frequencies or times, which go one way; `row` are the numbers of the rows in the file."""
    if layout.sampling_Hz is not None:
        axis = np.asarray(np.arange(row.size) / layout.sampling_Hz, float)
    elif layout.axis_column:
        axis = table[layout.axis_column].real
    else:
        axis = layout.axis_start + layout.axis_step * np.arange(row.size)
    if layout.layout == "time":
        where = f"{path}: column {layout.axis_column}"
        require_ascending(where, "row", int(row[0]), axis, "[measurement.table]")
    elif not np.all(np.diff(axis) > 0) and not np.all(np.diff(axis) < 0):
        at = row[1 + int(np.argmin(np.diff(axis) > 0))]
        raise MeasurementError(f"{path}: row {at}, column {layout.axis_column}: the frequency does not ascend")
    return np.asarray(axis)


def _functions(
    path: Path,
    layout: TableLayout,
    columns: tuple[tuple[int, ...], ...],
    table: dict[int, NDArray[Any]],
    axis: Reals,
    unit: Unit | None,
) -> tuple[MeasuredFunction, ...]:
    functions = []
    for group in columns:
        source = f"{path}: column {', '.join(map(str, group))}"
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is for the quality check to say
            value = _complex(layout, [table[c] for c in group]) * (1.0 if unit is None else unit.factor)
        functions.append(
            MeasuredFunction(
                kind="response" if layout.layout == "time" else "frf",
                abscissa=axis,
                value=value,
                quantity=None if unit is None else unit.frf,
                output=None,
                input=None,
                source=source,
            )
        )
    for column in layout.coherence_columns:
        functions.append(
            MeasuredFunction(
                kind="coherence",
                abscissa=axis,
                value=table[column].real,
                quantity=None,
                output=None,
                input=None,
                source=f"{path}: column {column}",
            )
        )
    return tuple(functions)


def read_points(path: Path, unit: Unit) -> Geometry:
    """Read a list of points: a header row ``node,x,y,z``, then one row for each point.

    The first may be called point or punkt, and units may stand in brackets behind the others. Columns may stand in any
    order and others are ignored; semicolons or tabs as delimiters allow decimal commas.

    Raises
    ------
    MeasurementError
        A column is missing or a row is not numbers; the message names file, row and column.
    """
    text = _text(path, "utf-8")
    delimiter, _ = point_columns(text.partition("\n")[0])
    reader = csv.DictReader(text.splitlines(), delimiter=delimiter, restkey=_BEYOND)
    try:
        return _points(path, reader, "." if delimiter == "," else ",", unit)
    except csv.Error as error:  # a cell without end
        raise MeasurementError(
            f"{path}: row {reader.line_num + 1}: expected a point number and x, y, z, found {error}"
        ) from error


def point_columns(head: str) -> tuple[str, tuple[str, ...]]:
    """Return what separates the columns of a list of points, by its first row, and what they are called."""
    mark = next((d for d in ";\t," if d in head), ",")
    delimiter = next(name for name, separator in SEPARATORS.items() if separator == mark)
    return mark, tuple(map(_point_column, cells_of(head, delimiter)))


def _point_column(title: str) -> str:
    name = title.strip().lstrip("#").strip().casefold()
    unit = _OF_UNIT.search(name)
    if unit is not None and unit[1].strip() in _LENGTHS:
        name = _OF_UNIT.sub("", name).strip()
    return "node" if re.fullmatch(_OF_NODE, name) else name


def said_unit(path: Path) -> str | None:
    """Return the unit in brackets behind the coordinates in the first row of a list of points; None without one."""
    labels = {match[1].strip() for match in _OF_UNIT.finditer(_text(path, "utf-8").partition("\n")[0])}
    return labels.pop() if len(labels) == 1 and labels <= _LENGTHS else None


def _points(path: Path, reader: csv.DictReader[str], decimal: str, unit: Unit) -> Geometry:
    names = {_point_column(name or ""): name for name in reader.fieldnames or ()}
    missing = [name for name in ("node", "x", "y", "z") if name not in names]
    if missing:
        raise MeasurementError(f"{path}: row 1 must name the columns node, x, y, z; missing: {', '.join(missing)}")
    points: dict[int, list[float]] = {}
    for row in reader:
        beyond = "".join(row.pop(_BEYOND, ())).strip()
        if not any((value or "").strip() for value in row.values()):
            continue
        if beyond:
            raise MeasurementError(
                f"{path}: row {reader.line_num} has more cells than row 1 has names; numbers with decimal commas need "
                "semicolons or tabs between the columns"
            )
        cells = {key: str(row[names[key]] or "").strip() for key in ("node", "x", "y", "z")}
        try:
            node = int(np.int64(cells["node"]))
            xyz = [float(cells[key].replace(decimal, ".")) for key in ("x", "y", "z")]
        except (ValueError, OverflowError) as error:
            raise MeasurementError(
                f"{path}: row {reader.line_num}: expected a point number and x, y, z, found "
                f"{', '.join(_shown(cell) for cell in cells.values())}"
            ) from error
        if node in points or not np.isfinite(xyz).all():
            raise MeasurementError(f"{path}: row {reader.line_num}: point {node} is given twice or not finite")
        points[node] = xyz
    if not points:
        raise MeasurementError(f"{path}: no points below the header row")
    return Geometry(
        node=np.array(list(points)),
        coordinate=np.array(list(points.values())) * unit.factor,
        line=np.empty((0, 2), dtype=np.int64),
    )


def _shown(cell: str, *, most_shown: int = 40) -> str:
    """Return a cell as a message shows it: quoted, and only its beginning where it is long.

    `most_shown`: characters of a cell in a message.
    """
    return repr(cell if len(cell) <= most_shown else f"{cell[:most_shown]}...")


def _text(path: Path, encoding: str) -> str:
    try:
        return decoded(unpacked(plain_bytes(path), path.suffix), encoding)
    except FileNotFoundError as error:
        raise MeasurementError(f"{path}: cannot be read: there is no such file") from error
    except (OSError, EOFError, ValueError, LookupError, gzip.zlib.error) as error:  # type: ignore[attr-defined]
        raise MeasurementError(
            f"{path}: cannot be read as text in encoding {encoding!r}: {error}; say encoding = 'latin-1' or "
            "another one in [measurement.table], or convert binary files (MATLAB, NumPy, zip) to CSV"
        ) from error


def _rows(path: Path, layout: TableLayout, rows: list[str]) -> list[str]:
    """Return the rows of numbers; words that an analyser writes below them are none, nor are empty rows."""
    if rows and _begins_with_number(rows[0], layout):
        while not _begins_with_number(rows[-1], layout):
            rows.pop()
    while rows and not rows[-1].strip():
        rows.pop()
    if not rows:
        raise MeasurementError(f"{path}: no rows of numbers after {layout.header_rows} header rows")
    return rows


def _begins_with_number(row: str, layout: TableLayout) -> bool:
    cells = cells_of(row, layout.delimiter)
    if not cells:
        return False
    try:
        number(ungrouped(cells[0], layout.decimal).replace(layout.decimal, ".").strip())
    except ValueError:
        return False
    return True


def _all_columns(width: int, layout: TableLayout, path: Path) -> tuple[tuple[int, ...], ...]:
    step = layout.width
    taken = {layout.axis_column, *layout.coherence_columns, *layout.output_columns, *layout.input_columns}
    free = [c for c in range(1, width + 1) if c not in taken]
    if not free or len(free) % step:
        raise MeasurementError(
            f"{path}: row {layout.header_rows + 1} has {len(free)} columns for functions, which is not "
            f"{step} for each; is the delimiter {layout.delimiter!r} right? Else name them in 'columns'"
        )
    return tuple(tuple(free[i : i + step]) for i in range(0, len(free), step))


def _require_width(path: Path, rows: list[str], layout: TableLayout, first: int) -> None:
    """Refuse a row with a number more than all others, in which columns are shifted."""
    separator = SEPARATORS[layout.delimiter]
    counts = np.array([row.count(separator) if separator else len(row.split()) for row in rows])
    usual = int(np.median(counts))
    for k in np.flatnonzero(counts > usual):
        cells = cells_of(rows[k], layout.delimiter)
        width = len(cells_of(rows[int(np.flatnonzero(counts == usual)[0])], layout.delimiter))
        if len(cells) > width and all(_begins_with_number(cell, layout) for cell in cells):
            raise MeasurementError(
                f"{path}: row {first + k + 1} has {len(cells)} numbers, and the others {width}: columns are shifted"
            )


def _numbers(
    path: Path, rows: list[str], layout: TableLayout, columns: list[int], first: int
) -> dict[int, NDArray[Any]]:
    """Return the wanted columns; numbers are read in one go, and cell by cell only to name the fault."""
    rows = plain_rows(rows, layout.delimiter, layout.decimal)
    if layout.layout != "complex":
        try:
            table = np.loadtxt(
                rows, delimiter=SEPARATORS[layout.delimiter], usecols=[c - 1 for c in columns], ndmin=2, comments=None
            )
            if len(table) == len(rows):
                return dict(zip(columns, table.T, strict=True))
        except ValueError:
            pass  # the loop below names the cell
    cells: dict[int, list[complex]] = {c: [] for c in columns}
    for index, row in enumerate(rows):
        words = cells_of(row, layout.delimiter)
        for column in columns:
            word = words[column - 1].strip() if column <= len(words) else ""
            try:
                cells[column].append(number(word))
            except ValueError as error:
                where = f"{path}: row {first + index + 1}, column {column}"
                message = f"{where}: expected a number, found {_shown(word)}"
                if index == len(rows) - 1:
                    message += (
                        "; it is the last row: where the file is cut off, copy it again or leave it out of 'files'"
                    )
                raise MeasurementError(message) from error
    return {column: np.array(values) for column, values in cells.items()}


def _complex(layout: TableLayout, columns: list[NDArray[Any]]) -> NDArray[Any]:
    if layout.layout == "time":
        return np.asarray(columns[0].real)
    if layout.layout == "complex":
        return np.asarray(columns[0], dtype=complex)
    first, second = columns[0].real, columns[1].real
    if layout.layout == "real-imaginary":
        return np.asarray(first + 1j * second)
    return from_polar(first, second, decibel=layout.magnitude_unit == "dB", degrees=layout.phase_unit == "deg")
