"""Modes as another program has them, before they become a modal model, and as tables of text.

The two tables are those that `lamella ema` writes, `modes.csv` and `shapes.csv`. In one table alone a column for each
measured DOF, such as ``12+z``, holds the shapes; of complex ones two, ``12+z_real`` and ``12+z_imag``.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.io.mode_titles import of_modes, of_shapes
from ema.types.errors import MeasurementError
from lamella_shared import plain_bytes, readonly


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
    notes : tuple of str
        What was odd in the file and how it was resolved.
    """

    source: str
    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
    frequency_std: NDArray[np.float64]
    damping_std: NDArray[np.float64]
    shape: NDArray[np.complex128]
    shape_std: NDArray[np.float64]
    scaled: NDArray[np.bool_]
    node: NDArray[np.int64]
    direction: NDArray[np.float64]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n_mode, n_dof = np.size(self.frequency), np.size(self.node)
        for name in ("frequency", "damping", "frequency_std", "damping_std", "shape_std"):
            object.__setattr__(self, name, readonly("FoundModes", name, getattr(self, name), (n_mode,)))
        expected: dict[str, tuple[tuple[int, ...], type]] = {
            "shape": ((n_dof, n_mode), complex),
            "scaled": ((n_mode,), bool),
            "node": ((n_dof,), int),
            "direction": ((n_dof, 3), float),
        }
        for name, (shape, dtype) in expected.items():
            object.__setattr__(self, name, readonly("FoundModes", name, getattr(self, name), shape, dtype))

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
        message = (
            f"{modes.source}: the shape of mode {int(np.flatnonzero(zero)[0]) + 1} is zero at every point; leave this "
            "mode out, or export it again"
        )
        raise MeasurementError(message)
    return replace(modes, shape=modes.shape[measured], node=modes.node[measured], direction=modes.direction[measured])


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
            message = f"{part.source}: point {dof[0]} stands twice in the same direction; a shape has each DOF once"
            raise MeasurementError(message)
    common = [dof for dof in places[0] if all(dof in rows_of for rows_of in places)]
    if not common:
        message = f"{first.source}: its modes have no point and direction in common; give those of one test"
        raise MeasurementError(message)
    notes = [note for part in parts for note in part.notes]
    left = max(map(len, places)) - len(common)
    if left:
        notes.append(f"{first.source}: {left} components are not in the shapes of all modes; they are left out of all")
    rows = [[rows_of[dof] for dof in common] for rows_of in places]

    def beside(name: str) -> NDArray[np.float64]:
        return np.concatenate([getattr(part, name) for part in parts])

    return FoundModes(
        source=first.source,
        frequency=beside("frequency"),
        damping=beside("damping"),
        frequency_std=beside("frequency_std"),
        damping_std=beside("damping_std"),
        shape=np.concatenate([part.shape[row] for part, row in zip(parts, rows, strict=True)], axis=1),
        shape_std=beside("shape_std"),
        scaled=np.concatenate([part.scaled for part in parts]),
        node=first.node[rows[0]],
        direction=first.direction[rows[0]],
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
    kind: str = ""  # of another program's, "modes" or "shapes"
    notes: tuple[str, ...] = ()

    def numbers(self, name: str, *, blank: bool = False) -> NDArray[np.float64]:
        """Return a column of numbers, NaN where a cell is empty and may be."""
        if name not in self.columns:
            message = f"{self.path}: no column {name!r}; the file has {', '.join(self.columns) or 'no header'}"
            raise MeasurementError(message)
        numbers = np.empty(len(self.columns[name]))
        for i, cell in enumerate(self.columns[name]):
            try:
                numbers[i] = np.nan if blank and not cell else float(cell.replace(self.decimal, "."))
            except ValueError as error:
                message = f"{self.path}: row {i + 2}: {name} is {cell!r}, expected a number"
                raise MeasurementError(message) from error
            if not (np.isfinite(numbers[i]) or (blank and not cell)):
                message = f"{self.path}: row {i + 2}: {name} is {cell!r}, expected a finite number"
                raise MeasurementError(message)
        return numbers

    def optional(self, name: str, n: int) -> NDArray[np.float64]:
        """Return a column of numbers; NaN where it, or a cell of it, is not there."""
        return self.numbers(name, blank=True) if name in self.columns else np.full(n, np.nan)


def is_table_of_modes(path: Path) -> bool:
    """Tell whether a text file begins with names, of frequencies and others of shapes or damping."""
    names = _first_names(path)
    has_shapes = any(_DOF.fullmatch(name) for name in names)
    if "frequency_hz" in names:
        return has_shapes or "damping" in names or "damping_percent" in names
    return "modes" in _of_others(path)


def is_table_of_shapes(path: Path) -> bool:
    """Tell whether a text file is a table of shapes, a row for each DOF."""
    names = _first_names(path)
    if {"node", "x", "y", "z"} <= names:
        return "mode_1_real" in names or "mode_1" in names
    return "shapes" in _of_others(path)


def _of_others(path: Path) -> set[str]:
    """Return what a table of another program is: of modes or of shapes."""
    try:
        table = _read(path)
    except MeasurementError:
        return set()
    return {table.kind} - {""}


def _first_names(path: Path, *, longest_row: int = 2**20) -> set[str]:
    """Return the cells of the first row of a text file in small letters; none where it is no text.

    `longest_row`: characters of names.
    """
    try:
        with path.open(encoding="utf-8-sig") as file:
            head = file.readline(longest_row).rstrip("\n")
    except (OSError, ValueError):
        return set()
    return {cell.strip().strip('"').casefold() for cell in re.split("[;\t,]", head)}


def read_modes_table(paths: tuple[Path, ...]) -> FoundModes:
    """Read modes from a table, or from one with the modes and one with their shapes, in any order.

    Raises
    ------
    MeasurementError
        A file cannot be read, lacks a column, or holds something that is not a number; the message names file, row and
        column.
    """
    of_shapes = [path for path in paths if "node" in _read(path).columns]
    of_modes = [path for path in paths if path not in of_shapes]
    if len(of_modes) != 1 or len(of_shapes) > 1:
        message = (
            f"{paths[0]}: tables of modes are one with a row for each mode (frequency_Hz, damping, perhaps a column "
            "for each DOF such as 12+z), and perhaps one with the shapes (node, x, y, z, mode_1_real, mode_1_imag, "
            "...); "
            f"found {', '.join(path.name for path in paths)}"
        )
        raise MeasurementError(message)
    table = _read(of_modes[0])
    frequency, damping = _poles(table)
    n = frequency.size
    node, direction, shape = _beside(table) if not of_shapes else _apart(_read(of_shapes[0]), n)
    scaled = [cell.casefold() in _YES for cell in table.columns.get("mass_normalised", [""] * n)]
    modes = FoundModes(
        source=str(of_modes[0]),
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
    )
    zero = np.flatnonzero(~np.any(shape != 0.0, axis=0))
    if zero.size:
        message = f"{(of_shapes or of_modes)[0]}: the shape of mode {zero[0] + 1} is zero at every point"
        raise MeasurementError(message)
    return joined([modes])  # which looks for DOFs that stand twice


def _poles(table: _Table) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return frequencies, Hz, and damping ratios; NaN where a damping is not stated."""
    frequency = table.numbers("frequency_hz")
    if not frequency.size:
        message = f"{table.path}: holds no mode below its header; expected a row for each"
        raise MeasurementError(message)
    if np.any(frequency <= 0.0):
        row = int(np.argmin(frequency))
        message = f"{table.path}: row {row + 2}: frequency_Hz is {frequency[row]:g}, expected a number above 0"
        raise MeasurementError(message)
    damping = table.optional("damping", frequency.size)
    percent = table.optional("damping_percent", frequency.size)
    damping = np.where(np.isnan(damping), percent / 100.0, damping)
    wrong = np.flatnonzero((damping <= 0.0) | (damping >= 1.0))
    if wrong.size:
        message = (
            f"{table.path}: row {wrong[0] + 2}: the damping ratio is {damping[wrong[0]]:g}, expected one above 0 and "
            "below 1; percent stand in a column damping_percent"
        )
        raise MeasurementError(message)
    return frequency, damping


def _deviation(table: _Table, name: str, n: int) -> NDArray[np.float64]:
    """Return standard deviations, NaN where they are not stated."""
    std = table.optional(name, n)
    wrong = np.flatnonzero(std < 0.0)
    if wrong.size:
        message = f"{table.path}: row {wrong[0] + 2}: {name} is {std[wrong[0]]:g}, expected a number of at least 0"
        raise MeasurementError(message)
    return np.where(std > 0.0, std, np.nan)


def _beside(table: _Table) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.complex128]]:
    """Return points, directions and shapes of the columns that are named as DOFs."""
    parts: dict[tuple[int, str, str], dict[str, NDArray[np.float64]]] = {}
    for name in table.columns:
        if (written := _DOF.fullmatch(name)) is not None:
            node, sign, axis, part = written.groups()
            parts.setdefault((int(node), sign, axis), {})[part or "real"] = table.numbers(name)
    if not parts:
        message = (
            f"{table.path}: holds no shapes: expected a column for each DOF, such as 12+z, or a second table with "
            f"node, x, y, z, mode_1_real, ...; the file has {', '.join(table.columns)}"
        )
        raise MeasurementError(message)
    zero = np.zeros(len(table.columns["frequency_hz"]))
    shape = [columns.get("real", zero) + 1j * columns.get("imag", zero) for columns in parts.values()]
    direction = [(-1.0 if sign == "-" else 1.0) * np.eye(3)["xyz".index(axis)] for _, sign, axis in parts]
    return np.array([node for node, _, _ in parts], dtype=np.int64), np.array(direction), np.array(shape)


def _apart(
    table: _Table, n: int, *, largest_node: int = 2**31 - 1
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.complex128]]:
    """Return points, directions and shapes of a table that has a row for each DOF."""
    number = table.numbers("node")
    odd = np.flatnonzero((number != np.round(number)) | (number < 0) | (number > largest_node))
    if odd.size:
        message = f"{table.path}: row {odd[0] + 2}: node is {number[odd[0]]:g}, expected a point number"
        raise MeasurementError(message)
    direction = np.column_stack([table.numbers(axis) for axis in "xyz"])
    length = np.linalg.norm(direction, axis=1)
    if np.any(length == 0.0) or not number.size:
        row = int(np.argmin(length)) + 2 if number.size else 2
        message = f"{table.path}: row {row}: x, y, z is the direction of a DOF and cannot be zero"
        raise MeasurementError(message)
    shape = np.empty((number.size, n), dtype=complex)
    for r in range(1, n + 1):
        real = f"mode_{r}" if f"mode_{r}" in table.columns else f"mode_{r}_real"
        shape[:, r - 1] = table.numbers(real)
        if f"mode_{r}_imag" in table.columns:
            shape[:, r - 1] += 1j * table.numbers(f"mode_{r}_imag")
    if f"mode_{n + 1}_real" in table.columns or f"mode_{n + 1}" in table.columns:
        message = f"{table.path}: has the shape of a mode {n + 1}, and the table of modes {n} rows; give as many"
        raise MeasurementError(message)
    return number.astype(np.int64), direction / length[:, None], shape


def _read(path: Path) -> _Table:
    """Read a table with a row of names; semicolons or tabs between the columns allow decimal commas."""
    try:
        text = plain_bytes(path).decode("utf-8-sig")
    except (OSError, ValueError) as error:
        message = f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}"
        raise MeasurementError(message) from error
    head = text.partition("\n")[0]
    delimiter = next((d for d in _DELIMITERS if d in head), ",")
    try:
        rows = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines(), delimiter=delimiter)]
    except csv.Error as error:
        message = f"{path}: not a table of text: {error}"
        raise MeasurementError(message) from error
    rows = [row for row in rows if any(row)]
    names = [name.casefold() for name in rows[0]] if rows else []
    twice = sorted({name for name in names if name and names.count(name) > 1})
    if twice:
        message = f"{path}: row 1 names the column {twice[0]!r} twice"
        raise MeasurementError(message)
    for number, row in enumerate(rows[1:], start=2):
        if len(row) > len(names):
            message = f"{path}: row {number} has {len(row)} cells, and row 1 {len(names)} names"
            raise MeasurementError(message)
    columns = {name: [row[k] if k < len(row) else "" for row in rows[1:]] for k, name in enumerate(names) if name}
    decimal, notes = "." if delimiter == "," else ",", list[str]()
    first = {"": [row[0] for row in rows[1:]]} if names and not names[0] else {}
    if (modes := of_modes({**first, **columns}, decimal, notes)) is not None:
        said = tuple(f"{path}: {note}" for note in notes)
        return _Table(path=path, columns=modes, decimal=decimal, kind="modes", notes=said)
    if (shapes := of_shapes(columns, decimal)) is not None:
        return _Table(path=path, columns=shapes, decimal=decimal, kind="shapes")
    return _Table(path=path, columns=columns, decimal=decimal)
