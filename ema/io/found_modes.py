"""Modes as another program has them, before they become a modal model, and as tables of text with its titles.

The two tables are those that `lamella ema` writes, `modes.csv` and `shapes.csv`. In one table alone a column for each
measured DOF, such as ``12+z``, holds the shapes; of complex ones two, ``12+z_real`` and ``12+z_imag``.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from ema.io.files import dof_name, dof_of_cells, dofs_in
from ema.types.errors import MeasurementError
from lamella_shared import Booleans, Complexes, Integers, Reals, plain_bytes, readonly


@dataclass(frozen=True, kw_only=True)
class ModesStd:
    """Relative standard deviations of modes that another program identified; None where the campaign states none.

    Attributes
    ----------
    frequency, damping : float or None
        Over the frequency and the damping ratio.
    shape : float or None
        Of a component, over the root mean square of the shape's components.
    """

    frequency: float | None = None
    damping: float | None = None
    shape: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class FoundModes:
    """Modes of one file or several; what the file does not state is NaN.

    Attributes
    ----------
    source : str
        The file, for messages.
    frequency, damping : (n_mode,) float
        Undamped natural frequencies, Hz, and damping ratios.
    frequency_std, damping_std : (n_mode,) float
        Their standard deviations, Hz and 1.
    shape : (n_dof, n_mode) complex
        Shapes of displacement: 1/sqrt(kg) where `scaled`, else of any scale.
    shape_std : (n_mode,) float
        Standard deviation of a component, over the root mean square of the components.
    scaled : (n_mode,) bool
        Which shapes have unit modal mass.
    node : (n_dof,) int
        Point of each component.
    direction : (n_dof, 3) float
        Its direction in global coordinates.
    sensor : (n_dof,) int
        Which accelerometer of a run measured a component, counted from 0.
    notes : tuple of str
        What was odd in the file and how it was resolved.
    """

    source: str
    frequency: Reals
    damping: Reals
    shape: Complexes
    scaled: Booleans
    node: Integers
    direction: Reals
    frequency_std: Reals = field(default_factory=lambda: np.array(np.nan))
    damping_std: Reals = field(default_factory=lambda: np.array(np.nan))
    shape_std: Reals = field(default_factory=lambda: np.array(np.nan))
    sensor: Integers = field(default_factory=lambda: np.array(0))
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n_mode, n_dof = np.size(self.frequency), np.size(self.node)
        expected: dict[str, tuple[tuple[int, ...], type]] = {
            **dict.fromkeys(("frequency", "damping", "frequency_std", "damping_std", "shape_std"), ((n_mode,), float)),
            "shape": ((n_dof, n_mode), complex),
            "scaled": ((n_mode,), bool),
            "node": ((n_dof,), int),
            "direction": ((n_dof, 3), float),
            "sensor": ((n_dof,), int),
        }
        for name, (shape, dtype) in expected.items():
            value = np.asarray(getattr(self, name))
            value = value if value.ndim else np.broadcast_to(value, shape)  # the same of all, as where it is unstated
            object.__setattr__(self, name, readonly("FoundModes", name, value, shape, dtype))

    @property
    def dofs(self) -> list[tuple[int, ...]]:
        """Point and direction of each component, to be compared."""
        rounded = np.round(1e6 * self.direction).astype(np.int64)
        return [(int(n), *map(int, d)) for n, d in zip(self.node, rounded, strict=True)]


def without_unmeasured(modes: FoundModes) -> FoundModes:
    """Leave out components that are zero in every mode: formats with three directions a point fill up with them.

    Raises
    ------
    MeasurementError
        A shape is zero throughout.
    """
    measured = np.any(modes.shape != 0.0, axis=1)
    zero = ~np.any(modes.shape != 0.0, axis=0)
    if zero.any():
        raise MeasurementError(
            f"{modes.source}: the shape of mode {int(np.flatnonzero(zero)[0]) + 1} is zero at every point; leave this "
            "mode out, or export it again"
        )
    return replace(
        modes,
        shape=modes.shape[measured],
        **{name: getattr(modes, name)[measured] for name in ("node", "direction", "sensor")},
    )


def joined(parts: Sequence[FoundModes]) -> FoundModes:
    """Put modes of several data sets or files beside each other, at the components that all of them have.

    Raises
    ------
    MeasurementError
        A component stands twice in one of them, or they have none in common.
    """
    first = parts[0]
    places = [{dof: row for row, dof in enumerate(part.dofs)} for part in parts]
    for part, rows_of in zip(parts, places, strict=True):
        if len(rows_of) < part.node.size:
            dof = next(dof for row, dof in enumerate(part.dofs) if rows_of[dof] != row)
            raise MeasurementError(
                f"{part.source}: point {dof[0]} stands twice in the same direction; a shape has each DOF once"
            )
    common = [dof for dof in places[0] if all(dof in rows_of for rows_of in places)]
    if not common:
        raise MeasurementError(
            f"{first.source}: its modes have no point and direction in common; give those of one test"
        )
    notes = [note for part in parts for note in part.notes]
    left = max(map(len, places)) - len(common)
    if left:
        notes.append(f"{first.source}: {left} components are not in the shapes of all modes; they are left out of all")
    rows = [[rows_of[dof] for dof in common] for rows_of in places]

    of_modes = ("frequency", "damping", "frequency_std", "damping_std", "shape_std", "scaled")
    return FoundModes(
        source=first.source,
        shape=np.concatenate([part.shape[row] for part, row in zip(parts, rows, strict=True)], axis=1),
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in of_modes},
        **{name: getattr(first, name)[rows[0]] for name in ("node", "direction", "sensor")},
        notes=tuple(dict.fromkeys(notes)),
    )


_DOF = re.compile(r"(\d{1,10})([+-])([xyz])(?:_(real|imag))?", re.IGNORECASE)
_DELIMITERS = ";\t,"
_YES = ("yes", "true", "1")


@dataclass(frozen=True, kw_only=True)
class _Table:
    """A table: its file, its columns by their names in small letters, and the decimal mark."""

    path: Path
    columns: dict[str, list[str]]
    decimal: str
    kind: Literal["modes", "shapes", ""]
    notes: tuple[str, ...] = ()

    def cells(self, name: str) -> list[str]:
        """Return a column as it stands."""
        if name not in self.columns:
            raise MeasurementError(
                f"{self.path}: no column {name!r}; the file has {', '.join(self.columns) or 'no header'}"
            )
        return self.columns[name]

    def numbers(self, name: str, *, blank: bool = False) -> Reals:
        """Return a column of numbers, NaN where a cell is empty and may be."""
        numbers = np.empty(len(self.cells(name)))
        for i, cell in enumerate(self.cells(name)):
            try:
                numbers[i] = np.nan if blank and not cell else float(cell.replace(self.decimal, "."))
            except ValueError as error:
                raise MeasurementError(f"{self.path}: row {i + 2}: {name} is {cell!r}, expected a number") from error
            if not (np.isfinite(numbers[i]) or (blank and not cell)):
                raise MeasurementError(f"{self.path}: row {i + 2}: {name} is {cell!r}, expected a finite number")
        return numbers

    def whole(self, name: str, *, largest: int = 2**31 - 1) -> Integers:
        """Return a column of whole numbers of at least 0, such as those of points."""
        numbers = self.numbers(name)
        odd = np.flatnonzero((numbers != np.round(numbers)) | (numbers < 0) | (numbers > largest))
        if odd.size:
            raise MeasurementError(
                f"{self.path}: row {odd[0] + 2}: {name} is {self.columns[name][odd[0]]!r}, expected a whole number "
                "of at least 0"
            )
        return numbers.astype(np.int64)

    def optional(self, name: str, n: int) -> Reals:
        """Return a column of numbers; NaN where it, or a cell of it, is not there."""
        return self.numbers(name, blank=True) if name in self.columns else np.full(n, np.nan)


def kind_of_table(path: Path) -> Literal["modes", "shapes", ""]:
    """Return whether a text file is a table of modes, of shapes (a row for each DOF), or neither."""
    try:
        return _read(path).kind
    except MeasurementError:
        return ""


def read_modes_table(paths: tuple[Path, ...], of: Mapping[str, str] | None = None) -> FoundModes:
    """Read modes from a table, or from one with the modes and one with their shapes, in any order.

    Parameters
    ----------
    paths : tuple of Path
        The tables.
    of : mapping of str to str, optional
        Whose modes: where a table has a column of that name, rows with another value are passed over.

    Raises
    ------
    MeasurementError
        A file cannot be read, lacks a column, or holds something that is not a number; the message names file, row and
        column.
    """
    tables = [_read(path, of) for path in paths]
    of_shapes = [table for table in tables if "node" in table.columns]
    of_modes = [table for table in tables if table not in of_shapes]
    if len(of_modes) != 1 or len(of_shapes) > 1:
        raise MeasurementError(
            f"{paths[0]}: tables of modes are one with a row for each mode (frequency_Hz, damping, perhaps a column "
            "for each DOF such as 12+z), and perhaps one with the shapes (node, x, y, z, mode_1_real, mode_1_imag, "
            f"...); found {', '.join(path.name for path in paths)}"
        )
    (table,) = of_modes
    frequency, damping = _poles(table)
    n = frequency.size
    node, direction, shape = _beside(table) if not of_shapes else _apart(of_shapes[0], n)
    of_rows = {"sensor": of_shapes[0].whole("sensor")} if of_shapes and "sensor" in of_shapes[0].columns else {}
    scaled = [cell.casefold() in _YES for cell in table.columns.get("mass_normalised", [""] * n)]
    modes = FoundModes(
        source=str(table.path),
        frequency=frequency,
        damping=damping,
        frequency_std=_deviation(table, "frequency_std_hz", n),
        damping_std=_deviation(table, "damping_std", n),
        shape=shape,
        shape_std=_deviation(table, "shape_std", n),
        scaled=np.array(scaled, dtype=bool),
        node=node,
        direction=direction,
        notes=table.notes,
        **of_rows,
    )
    zero = np.flatnonzero(~np.any(shape != 0.0, axis=0))
    if zero.size:
        raise MeasurementError(
            f"{(of_shapes or of_modes)[0].path}: the shape of mode {zero[0] + 1} is zero at every point"
        )
    return joined([modes])  # which looks for DOFs that stand twice


def poles_in_table(path: Path, column: str, of: Mapping[str, str]) -> tuple[tuple[str, ...], Reals]:
    """Read modes without shapes, and a column of words about each of them.

    Parameters
    ----------
    path, of
        As in `read_modes_table`.
    column : str
        The title of the column.

    Returns
    -------
    (n_mode,) str, (4, n_mode) float
        The words; frequencies, their standard deviations, Hz, damping ratios and theirs, NaN where unstated.
    """
    table = _read(path, of)
    frequency, damping = _poles(table)
    std = (_deviation(table, name, frequency.size) for name in ("frequency_std_hz", "damping_std"))
    words = tuple(table.cells(column))
    return words, np.stack([frequency, next(std), damping, next(std)])


def _poles(table: _Table) -> tuple[Reals, Reals]:
    """Return frequencies, Hz, and damping ratios; NaN where a damping is not stated."""
    frequency = table.numbers("frequency_hz")
    if not frequency.size:
        raise MeasurementError(f"{table.path}: holds no mode below its header; expected a row for each")
    if np.any(frequency <= 0.0):
        row = int(np.argmin(frequency))
        raise MeasurementError(
            f"{table.path}: row {row + 2}: frequency_Hz is {frequency[row]:g}, expected a number above 0"
        )
    damping = table.optional("damping", frequency.size)
    percent = table.optional("damping_percent", frequency.size)
    damping = np.where(np.isnan(damping), percent / 100.0, damping)
    wrong = np.flatnonzero((damping <= 0.0) | (damping >= 1.0))
    if wrong.size:
        raise MeasurementError(
            f"{table.path}: row {wrong[0] + 2}: the damping ratio is {damping[wrong[0]]:g}, expected one above 0 and "
            "below 1; percent stand in a column damping_percent"
        )
    return frequency, damping


def _deviation(table: _Table, name: str, n: int) -> Reals:
    """Return standard deviations, NaN where they are not stated."""
    std = table.optional(name, n)
    wrong = np.flatnonzero(std < 0.0)
    if wrong.size:
        raise MeasurementError(
            f"{table.path}: row {wrong[0] + 2}: {name} is {std[wrong[0]]:g}, expected a number of at least 0"
        )
    return np.where(std > 0.0, std, np.nan)


def _beside(table: _Table) -> tuple[Integers, Reals, Complexes]:
    """Return points, directions and shapes of the columns that are named as DOFs."""
    parts: dict[tuple[int, str, str], dict[str, Reals]] = {}
    for name in table.columns:
        if (written := _DOF.fullmatch(name)) is not None:
            node, sign, axis, part = written.groups()
            parts.setdefault((int(node), sign, axis), {})[part or "real"] = table.numbers(name)
    if not parts:
        raise MeasurementError(
            f"{table.path}: holds no shapes: expected a column for each DOF, such as 12+z, or a second table with "
            f"node, x, y, z, mode_1_real, ...; the file has {', '.join(table.columns)}"
        )
    zero = np.zeros(len(table.columns["frequency_hz"]))
    shape = [columns.get("real", zero) + 1j * columns.get("imag", zero) for columns in parts.values()]
    direction = [(-1.0 if sign == "-" else 1.0) * np.eye(3)["xyz".index(axis)] for _, sign, axis in parts]
    return np.array([node for node, _, _ in parts], dtype=np.int64), np.array(direction), np.array(shape)


def _apart(table: _Table, n: int) -> tuple[Integers, Reals, Complexes]:
    """Return points, directions and shapes of a table that has a row for each DOF."""
    number = table.whole("node")
    direction = np.column_stack([table.numbers(axis) for axis in "xyz"])
    length = np.linalg.norm(direction, axis=1)
    if np.any(length == 0.0) or not number.size:
        row = int(np.argmin(length)) + 2 if number.size else 2
        raise MeasurementError(f"{table.path}: row {row}: x, y, z is the direction of a DOF and cannot be zero")
    shape = np.empty((number.size, n), dtype=complex)
    for r in range(1, n + 1):
        real = f"mode_{r}" if f"mode_{r}" in table.columns else f"mode_{r}_real"
        shape[:, r - 1] = table.numbers(real)
        if f"mode_{r}_imag" in table.columns:
            shape[:, r - 1] += 1j * table.numbers(f"mode_{r}_imag")
    if f"mode_{n + 1}_real" in table.columns or f"mode_{n + 1}" in table.columns:
        raise MeasurementError(
            f"{table.path}: has the shape of a mode {n + 1}, and the table of modes {n} rows; give as many"
        )
    return number, direction / length[:, None], shape


def _read(path: Path, of: Mapping[str, str] | None = None) -> _Table:
    """Read a table with a row of names; semicolons or tabs between the columns allow decimal commas."""
    try:
        text = plain_bytes(path).decode("utf-8-sig")
    except (OSError, ValueError) as error:
        raise MeasurementError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    head = text.partition("\n")[0]
    delimiter = next((d for d in _DELIMITERS if d in head), ",")
    try:
        rows = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines(), delimiter=delimiter)]
    except csv.Error as error:
        raise MeasurementError(f"{path}: not a table of text: {error}") from error
    rows = [row for row in rows if any(row)]
    names = [name.casefold() for name in rows[0]] if rows else []
    twice = sorted({name for name in names if name and names.count(name) > 1})
    if twice:
        raise MeasurementError(f"{path}: row 1 names the column {twice[0]!r} twice")
    for number, row in enumerate(rows[1:], start=2):
        if len(row) > len(names):
            raise MeasurementError(f"{path}: row {number} has {len(row)} cells, and row 1 {len(names)} names")
    columns = {name: [row[k] if k < len(row) else "" for row in rows[1:]] for k, name in enumerate(names) if name}
    columns = _rows_of(path, columns, of or {})
    decimal, notes = "." if delimiter == "," else ",", list[str]()
    first = {"": [row[0] for row in rows[1:]]} if names and not names[0] else {}
    if (modes := of_modes({**first, **columns}, decimal, notes)) is not None:
        said = tuple(f"{path}: {note}" for note in notes)
        return _Table(path=path, columns=modes, decimal=decimal, kind="modes", notes=said)
    if (shapes := of_shapes(columns, decimal)) is not None:
        return _Table(path=path, columns=shapes, decimal=decimal, kind="shapes")
    of_points = {"node", "x", "y", "z"} <= columns.keys() and not {"mode_1", "mode_1_real"}.isdisjoint(columns)
    of_poles = "frequency_hz" in columns and (
        not {"damping", "damping_percent"}.isdisjoint(columns) or any(map(_DOF.fullmatch, columns))
    )
    return _Table(
        path=path, columns=columns, decimal=decimal, kind="modes" if of_poles else "shapes" if of_points else ""
    )


def _rows_of(path: Path, columns: Columns, of: Mapping[str, str]) -> Columns:
    """Return the rows of one specimen or configuration, where the table has columns that name these."""
    given = {name: value for name, value in of.items() if name in columns}
    keys = list(zip(*(columns[name] for name in given), strict=True))
    kept = [i for i, key in enumerate(keys) if key == tuple(given.values())]
    if keys and not kept:
        wanted = ", ".join(f"{name} {value!r}" for name, value in given.items())
        there = ", ".join(dict.fromkeys(" ".join(key) for key in keys))
        raise MeasurementError(f"{path}: no row of {wanted}; the file has {there}")
    return {name: [cells[i] for i in kept] for name, cells in columns.items()} if keys else columns


Columns = dict[str, list[str]]
"""The cells below each title, titles in small letters."""

_STD = re.compile(r"\bstd|std\.|deviation|uncert|±|sigma")
_FREQUENCY = re.compile(r"freq|^f_?n?\b|^f_?\d?$|omega|^w_?n\b")
_DAMPING = re.compile(r"damp|zeta|ζ|ξ|^xi\b|dämpf")
_LOSS = re.compile(r"loss|^eta\b|η|verlust")
_MODE = re.compile(r"(?:mode|shape|phi|eigenform)\D{0,8}(\d+)")
_POINT = re.compile(r"^(node|point|pt|knoten|punkt|dof|point ?id|location)\b")
_DIRECTION = re.compile(r"^(dir\w*|axis|richtung)\b")
_PARTS = (
    ("imag", re.compile(r"\bim(ag\w*)?\b")),
    ("phase", re.compile(r"phase|angle")),
    ("magnitude", re.compile(r"\bmag\w*|\bamp\w*|\babs\b")),
    ("real", re.compile(r"\bre(al)?\b|")),
)
_OWN = {"frequency_hz", "node"}  # tables that have these titles are as `lamella ema` writes them


def are_percent(damping: Iterable[float]) -> bool:
    """Whether damping ratios must be in per cent: resonances of such ratios are not seen."""
    most = 0.3  # damping ratio that no usual mode passes: half of the modes beyond it, or one beyond 1, are in per cent
    known = [x for x in damping if x > 0.0]
    return bool(known) and (max(known) >= 1.0 or float(np.median(known)) > most)


def of_modes(columns: Columns, decimal: str, notes: list[str]) -> Columns | None:
    """Return a table of modes with the titles of `lamella ema`; None where it is none, or has these titles.

    It has a column of frequencies and one of damping ratios, or these as rows.

    Parameters
    ----------
    columns : dict of str to list of str
        The table.
    decimal : str
        Decimal mark.
    notes : list of str
        What is taken for granted is added to it.
    """
    if _OWN & columns.keys():
        return None
    for table in (columns, _turned(columns)):
        named = {kind: title for title in table if (kind := _kind(title)) is not None}
        if "frequency" in named and named.keys() & {"ratio", "percent", "loss", "unstated", "decay"}:
            return _renamed(table, named, decimal, notes)
    return None


def _kind(title: str) -> str | None:
    """Return what a title of a table of modes means; None where it is something else."""
    is_std = _STD.search(title) is not None
    if _LOSS.search(title):
        return None if is_std else "loss"
    if _DAMPING.search(title):
        kind = "unstated"
        if "%" in title or "percent" in title:
            kind = "percent"
        elif re.search(r"\bhz\b|rad|1/s", title):
            kind = "decay"
        elif re.search(r"ratio|zeta|ζ|ξ|^xi\b|\[-\]|\(-\)|\[1\]", title):
            kind = "ratio"
        return f"{kind} std" if is_std else kind
    if _FREQUENCY.search(title) and "res" not in title:
        return "frequency std" if is_std else "frequency"
    return None


def _renamed(table: Columns, named: dict[str, str], decimal: str, notes: list[str]) -> Columns:
    """Return the columns of a table of modes under the titles of `lamella ema`, in Hz and as ratios."""
    renamed: Columns = {}
    title = named["frequency"]
    to_hertz = 1.0 / (2.0 * np.pi) if "rad" in title else 1e3 if "khz" in title else 1.0
    renamed["frequency_hz"] = _times(table[title], to_hertz, decimal)
    if "frequency std" in named:
        renamed["frequency_std_hz"] = _times(table[named["frequency std"]], to_hertz, decimal)
    kind = next(k for k in ("percent", "ratio", "unstated", "loss", "decay") if k in named)
    cells = table[named[kind]]
    factor = {"percent": 0.01, "loss": 0.5}.get(kind, 1.0)
    if kind == "unstated":
        factor = 0.01 if are_percent(_numbers(cells, decimal)) else 1.0
        taken = "in per cent, for as ratios they are no resonances" if factor < 1.0 else "as ratios"
        notes.append(f"the column {named[kind]!r} says no unit; its numbers are taken {taken}")
    if kind == "decay":  # over the frequency in the same unit
        of_title = 1.0 / (2.0 * np.pi) if re.search(r"rad|1/s", named[kind]) else 1.0
        pairs = zip(_times(cells, of_title, decimal), renamed["frequency_hz"], strict=True)
        cells = [_ratio(decay, hertz, decimal) for decay, hertz in pairs]
    renamed["damping"] = _times(cells, factor, decimal)
    if f"{kind} std" in named:
        renamed["damping_std"] = _times(table[named[f"{kind} std"]], factor, decimal)
    used = set(named.values())
    for title, cells in table.items():
        dofs = dofs_in(title) if title not in used else []
        if len(dofs) == 1:
            part = _part(re.sub(r"\d+\W*[xyz]\b", "", title))
            renamed[f"{dof_name(dofs[0])}_{part}"] = cells
    return _joined(renamed, decimal)


def of_shapes(columns: Columns, decimal: str) -> Columns | None:
    """Return a table of shapes, a row for each DOF, with the titles of `lamella ema`; None where it is none."""
    if {"node", "x", "y", "z"} <= columns.keys():
        return None
    point = next((title for title in columns if _POINT.search(title)), None)
    modes = {title: match for title in columns if (match := _MODE.search(title)) is not None and title != point}
    if point is None or not modes:
        return None
    direction = next((title for title in columns if _DIRECTION.search(title) and title not in modes), None)
    beside = [""] * len(columns[point]) if direction is None else columns[direction]
    dofs = [dof_of_cells(cells) for cells in zip(columns[point], beside, strict=True)]
    if any(dof is None for dof in dofs):
        return None
    codes = [dof for dof in dofs if dof is not None]
    shapes: Columns = {"node": [str(node) for node, _ in codes]}
    for k, axis in enumerate("xyz"):
        shapes[axis] = [str(int(np.sign(code)) if abs(code) == k + 1 else 0) for _, code in codes]
    for title, match in modes.items():
        shapes[f"mode_{match[1]}_{_part(title[match.end() :])}"] = columns[title]
    return _joined(shapes, decimal)


def _part(title: str) -> str:
    """Return which part of complex numbers a title names, `real` where it names none."""
    return next(part for part, words in _PARTS if words.search(title.casefold().replace("_", " ")))


def _joined(columns: Columns, decimal: str) -> Columns:
    """Return a table in which magnitudes and phases, in degrees, have become real and imaginary parts."""
    joined = dict(columns)
    for title in columns:
        start, _, part = title.rpartition("_")
        if part != "magnitude" or f"{start}_phase" not in columns:
            continue
        pairs = zip(joined.pop(title), joined.pop(f"{start}_phase"), strict=True)
        value = [_polar(size, phase, decimal) for size, phase in pairs]
        joined[f"{start}_real"] = [real for real, _ in value]
        joined[f"{start}_imag"] = [imaginary for _, imaginary in value]
    return joined


def _turned(columns: Columns) -> Columns:
    """Return a table whose first column holds the titles, with its rows as columns."""
    if len(columns) < 2:
        return {}
    first, *others = columns.values()
    return {title.casefold(): [cells[k] for cells in others] for k, title in enumerate(first)}


def _numbers(cells: list[str], decimal: str) -> Iterator[float]:
    for cell in cells:
        try:
            yield float(cell.replace(decimal, "."))
        except ValueError:
            continue


def _times(cells: list[str], factor: float, decimal: str) -> list[str]:
    """Return cells times a factor; one that holds no number stays, for reading to name it."""
    return cells if factor == 1.0 else [_each(cell, lambda x: x * factor, decimal) for cell in cells]


def _each(cell: str, change: Callable[[float], float], decimal: str) -> str:
    try:
        return repr(float(change(float(cell.replace(decimal, "."))))).replace(".", decimal)
    except ValueError:
        return cell


def _ratio(decay: str, hertz: str, decimal: str) -> str:
    frequency = next(_numbers([hertz], decimal), 0.0)
    return _each(decay, lambda x: x / np.hypot(x, frequency), decimal) if frequency > 0.0 else decay


def _polar(size: str, phase: str, decimal: str) -> tuple[str, str]:
    angle = np.deg2rad(next(_numbers([phase], decimal), np.nan))
    return (_each(size, lambda x: x * np.cos(angle), decimal), _each(size, lambda x: x * np.sin(angle), decimal))
