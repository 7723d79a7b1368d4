"""Campaigns whose measured modes come as a table instead of as FRFs: G_f of every row, paired by shape class."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ema.io.files import Section
from lamella_shared import arrays, read_form
from model import Stack, observe, read_stack, reduce
from updating.correlation.shape_class import class_grid, solve_by_class
from updating.errors import FitError
from updating.fitting.fit import G_F_BOUNDS, N_SNAPSHOT_WIDE, Estimate, Prediction, estimate_stiffness, frequency_error


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"n": "frequency published_frequency"})
class TableRow:
    """One configuration of a modal table.

    Attributes
    ----------
    name : str
        The configuration.
    stack : Stack
        Its stack: the shared planform with the row's height and pressure.
    frequency : (n_mode,) float
        Measured natural frequencies, Hz.
    published_frequency : (n_mode,) float
        Natural frequencies of the published model, Hz.
    published_G_f : float
        Published contact stiffness; NaN where the source gives none.
    """

    name: str
    stack: Stack
    frequency: NDArray[np.float64]
    published_frequency: NDArray[np.float64]
    published_G_f: float


@dataclass(frozen=True, eq=False, kw_only=True)
class ModalTable:
    """A campaign given as a table of natural frequencies.

    Attributes
    ----------
    name : str
        The campaign.
    shape_class : tuple of str
        Class of each mode, such as "torsion 1"; modes are paired by it, never by order.
    rows : tuple of TableRow
        The configurations.
    inputs : tuple of Path
        The files that it was read from.
    """

    name: str
    shape_class: tuple[str, ...]
    rows: tuple[TableRow, ...]
    inputs: tuple[Path, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"row.frequency": "frequency frequency_to_published"})
class TableFit:
    """One row of a modal table fitted.

    Attributes
    ----------
    row : TableRow
        What was fitted.
    G_f : Estimate
        Contact stiffness fitted to the measured frequencies by opt_G.
    frequency : (n_mode,) float
        Model frequencies at that G_f, Hz.
    error : float
        Eq. (2) of `frequency` against the measured ones, as a ratio.
    published_error : float
        Eq. (2) of the published model against the measured ones, as a ratio.
    G_f_to_published : Estimate
        Contact stiffness fitted to the published model's frequencies.
    frequency_to_published : (n_mode,) float
        Model frequencies at that G_f, Hz.
    model_misfit : float
        Eq. (2) of `frequency_to_published` against the published model's frequencies, as a ratio.
    """

    row: TableRow
    G_f: Estimate
    frequency: NDArray[np.float64]
    error: float
    published_error: float
    G_f_to_published: Estimate
    frequency_to_published: NDArray[np.float64]
    model_misfit: float


def read_modal_table(path: Path) -> ModalTable:
    """Read a campaign file with a `[modal_table]` section and the tables that it names.

    Raises
    ------
    FitError
        A key is missing or unknown, or a table lacks a column or holds something that is not a number.
    """
    described = read_form(path, ModalTableFile, FitError)
    table = described.modal_table
    n_mode = len(table.shape_class)
    for key in ("frequency_Hz", "published_frequency_Hz"):
        if len(getattr(table, key)) != n_mode:
            message = f"{path}: modal_table.{key} names {len(getattr(table, key))} columns for {n_mode} shape classes"
            raise FitError(message)
    folder = path.parent
    shared = read_stack(folder / described.structure.stack)
    height = _column(folder / table.height.file, table.height.configuration, table.height.height_mm)
    G_f = _column(
        folder / table.published_contact.file, table.published_contact.configuration, table.published_contact.G_f
    )
    columns = [
        _column(folder / table.file, table.configuration, c)
        for c in (*table.frequency_Hz, *table.published_frequency_Hz)
    ]
    rows = []
    for name in columns[0]:
        if name not in height:
            message = f"{folder / table.height.file}: no row for configuration {name!r} of {table.file}"
            raise FitError(message)
        values = [column[name] for column in columns]
        stack = replace(
            shared,
            name=f"{shared.name}, stack {name}",
            height=1e-3 * height[name],
            contact=replace(shared.contact, pressure=1e3 * table.pressure_kPa),
        )
        rows.append(
            TableRow(
                name=name,
                stack=stack,
                frequency=np.array(values[:n_mode]),
                published_frequency=np.array(values[n_mode:]),
                published_G_f=G_f.get(name, float("nan")),
            )
        )
    files = (described.structure.stack, table.file, table.height.file, table.published_contact.file)
    return ModalTable(
        name=described.campaign.name,
        shape_class=tuple(table.shape_class),
        rows=tuple(rows),
        inputs=(path, *(folder / f for f in files)),
    )


def fit_row(row: TableRow, shape_class: tuple[str, ...]) -> TableFit:
    """Fit G_f of one row to the measured frequencies, and once more to those of the published model.

    Raises
    ------
    FitError
        The model has no mode of a wanted class at a G_f of the scan.
    """
    return fit_row_by(row, _predictor(row, shape_class))


def fit_row_by(row: TableRow, predict: Callable[[float], Prediction]) -> TableFit:
    """Fit G_f of one row as `fit_row` does, with a given model.

    Parameters
    ----------
    row : TableRow
        The configuration.
    predict : callable
        Model frequencies (n_mode,) and their derivatives by G_f at a value of G_f.
    """
    no_std = np.zeros(row.frequency.size)
    G_f = estimate_stiffness(predict, row.frequency, no_std, bounds=G_F_BOUNDS)
    G_f_to_published = estimate_stiffness(predict, row.published_frequency, no_std, bounds=G_F_BOUNDS)
    frequency, frequency_to_published = predict(G_f.value)[0], predict(G_f_to_published.value)[0]
    return TableFit(
        row=row,
        G_f=G_f,
        frequency=frequency,
        error=frequency_error(row.frequency, frequency),
        published_error=frequency_error(row.frequency, row.published_frequency),
        G_f_to_published=G_f_to_published,
        frequency_to_published=frequency_to_published,
        model_misfit=frequency_error(row.published_frequency, frequency_to_published),
    )


def _predictor(row: TableRow, shape_class: tuple[str, ...]) -> Callable[[float], Prediction]:
    system = reduce(row.stack, G_f_range=G_F_BOUNDS, n_snapshot=N_SNAPSHOT_WIDE)
    grid = observe(system, class_grid(row.stack))

    def predict(G_f: float) -> Prediction:
        modes, column = solve_by_class(system, grid, shape_class, G_f=G_f)
        if np.any(column < 0):
            missing = [name for name, c in zip(shape_class, column, strict=True) if c < 0]
            message = f"stack {row.name}: the model has no mode of class {', '.join(missing)} at G_f = {G_f:g}"
            raise FitError(message)
        return modes.frequency[column], modes.frequency_gradient[column, modes.parameter.index("G_f")]

    return predict


def _column(path: Path, key: str, column: str) -> dict[str, float]:
    """Read one column of numbers of a CSV table by the entries of its key column."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            names = reader.fieldnames or []
            for name in (key, column):
                if name not in names:
                    message = f"{path}: no column {name!r}; the file has {', '.join(names)}"
                    raise FitError(message)
            values = {}
            for row in reader:
                try:
                    values[row[key]] = float(row[column])
                except (TypeError, ValueError) as error:
                    message = f"{path}, line {reader.line_num}: {column} is {row[column]!r}, expected a number"
                    raise FitError(message) from error
            return values
    except (OSError, ValueError, csv.Error) as error:
        message = f"cannot read {path}: {getattr(error, 'strerror', None) or error}"
        raise FitError(message) from error


class _Name(Section):
    name: str


class _Structure(Section):
    stack: str


class _Height(Section):
    file: str
    configuration: str
    height_mm: str


class _PublishedContact(Section):
    file: str
    configuration: str
    G_f: str


class _Table(Section):
    file: str
    configuration: str
    frequency_Hz: Annotated[list[str], Field(min_length=1)]
    published_frequency_Hz: list[str]
    shape_class: list[str]
    pressure_kPa: Annotated[float, Field(gt=0)]
    height: _Height
    published_contact: _PublishedContact


class ModalTableFile(Section):
    """The form of the whole file."""

    campaign: _Name
    structure: _Structure
    modal_table: _Table
