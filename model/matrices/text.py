"""Text files of other programs: opened, and their numbers read with the line of a fault."""

from __future__ import annotations

import csv
import gzip
import io
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model.stack.errors import MatricesError
from model.stack.files import plain_text


def read_text(path: Path) -> str:
    """Return the text of a file, which may be compressed by gzip (`.gz`).

    Raises
    ------
    MatricesError
        It cannot be read, or is empty.
    """
    try:
        if path.suffix == ".gz":
            with gzip.open(path, "rt", encoding="utf-8") as file:
                text = file.read()
        else:
            text = plain_text(path)
    except (OSError, EOFError, ValueError) as error:
        message = f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})"
        raise MatricesError(message) from error
    if not text.strip():
        message = f"{path}: is empty"
        raise MatricesError(message)
    return text


def kind_of(path: Path) -> str:
    """Return the suffix of a file in small letters, without that of its compression."""
    suffixes = [one.lower() for one in path.suffixes if one.lower() != ".gz"]
    return suffixes[-1] if suffixes else ""


def numbers(
    path: Path, text: str, n_column: int, form: str, delimiter: str | None = None
) -> NDArray[np.float64]:
    """Return a table of numbers, (n, n_column).

    Raises
    ------
    MatricesError
        A line holds something else; the message says which, and the `form` that is right.
    """
    try:
        found = np.loadtxt(io.StringIO(text), ndmin=2, delimiter=delimiter, comments=None)
    except ValueError as error:
        message = f"{path}: {str(error).rstrip('.')}; each line must be: {form}"
        raise MatricesError(message) from error
    if found.shape[1] != n_column:
        message = f"{path}: has {found.shape[1]} columns; each line must be: {form}"
        raise MatricesError(message)
    return found


def rows_of_csv(path: Path, needed: Iterable[str]) -> list[dict[str, str]]:
    """Return the rows of a CSV table by the names of its columns.

    Raises
    ------
    MatricesError
        It lacks a column.
    """
    reader = csv.DictReader(io.StringIO(read_text(path)), skipinitialspace=True)
    names = [name.strip().lower() for name in reader.fieldnames or ()]
    missing = [name for name in needed if name not in names]
    if missing:
        message = f"{path}: lacks the columns {', '.join(missing)}; it has {', '.join(names)}"
        raise MatricesError(message)
    reader.fieldnames = names
    return list(reader)
