"""Files of other programs: their kinds, numbers with the line of a fault, a first structure file for a folder."""

from __future__ import annotations

import csv
import gzip
import io
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from lamella_shared import plain_text
from model.stack.errors import MatricesError


def refuse(message: str) -> NoReturn:
    """Refuse what is given, with the words that a user reads; an error that is being handled is its cause."""
    raise MatricesError(message)


def read_text(path: Path, *, ended: bool = False) -> str:
    """Return the text of a file, which may be compressed by gzip (`.gz`).

    Raises
    ------
    MatricesError
        It cannot be read, is empty, or lacks the end of its last line where it must be `ended`, as programs write it.
    """
    try:
        if path.suffix == ".gz":
            with gzip.open(path, "rt", encoding="utf-8") as file:
                text = file.read()
        else:
            text = plain_text(path)
    except (OSError, EOFError, ValueError) as error:
        refuse(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})")
    if not text.strip():
        refuse(f"{path}: is empty")
    if ended and not text.rstrip(" \t\x00").endswith(("\n", "\r")):
        last = text.splitlines()[-1].strip()
        refuse(f"{path}: its last line has no end ({last!r}): it is cut off. Copy it again, or end that line")
    return text


def kind_of(path: Path) -> str:
    """Return the suffix of a file in small letters, without that of its compression."""
    suffixes = [one.lower() for one in path.suffixes if one.lower() != ".gz"]
    return suffixes[-1] if suffixes else ""


def numbers(path: Path, text: str, n_column: int, form: str, delimiter: str | None = None) -> NDArray[np.float64]:
    """Return a table of numbers, (n, n_column).

    Raises
    ------
    MatricesError
        A line holds something else; the message says which, and the `form` that is right.
    """
    plain = re.sub(r"(?<=[\d.])[dD](?=[+-]?\d)", "e", text) if "D" in text or "d" in text else text  # of Fortran
    try:
        found = np.loadtxt(io.StringIO(plain), ndmin=2, delimiter=delimiter, comments=None)
    except ValueError as error:
        fault = str(error).partition(";")[0].rstrip(".")  # without advice of numpy to programmers
        refuse(f"{path}: {fault}; each line must be: {form}")
    if found.shape[1] != n_column:
        refuse(f"{path}: has {found.shape[1]} columns; each line must be: {form}")
    return found


def columns_of_csv(path: Path, needed: Sequence[str]) -> list[list[str]]:
    """Return columns of a CSV table by their names; cells that are not there are empty.

    Semicolons or tabs between the columns allow decimal commas.

    Raises
    ------
    MatricesError
        It lacks a column.
    """
    text = read_text(path)
    head = text.lstrip("\ufeff").partition("\n")[0]
    delimiter = next((one for one in ";\t" if one in head), ",")
    if delimiter != ",":
        text = text.replace(",", ".")
    reader = csv.reader(io.StringIO(text.lstrip("\ufeff")), delimiter=delimiter, skipinitialspace=True)
    names = [name.strip().lower() for name in next(reader, [])]
    missing = [name for name in needed if name not in names]
    if missing:
        refuse(f"{path}: lacks the columns {', '.join(missing)}; it has {', '.join(names)}")
    table = [row for row in reader if row]
    at = [names.index(name) for name in needed]
    return [[row[i] if i < len(row) else "" for row in table] for i in at]


FILE = "structure.toml"

_PAIRS = (
    (r"\.sti$", r"\.mas$"),  # CalculiX
    (r"_STIF\d*\.mtx$", r"_MASS\d*\.mtx$"),  # Abaqus
    (r"^(k|stiff)[^/]*\.(mmf|mtx|npz|mat)$", r"^(m|mass)[^/]*\.(mmf|mtx|npz|mat)$"),
)
"""Names of stiffness and mass as programs, and people, give them."""

_ARRAYS, _LABELS, _NODES = (".npz", ".mat"), (".dof", ".mapping"), (".inp", ".bdf", ".dat", ".nas", ".cdb")


_DRAFT = """name = {0}

[matrices]
units = "?"              # to be filled in: of all files, such as "mm-t-s" or "m-kg-s"
stiffness = {1}   # guessed by its name
mass = {2}   # guessed by its name
{3}# total_mass_kg = 1.0   # what the structure weighs, which checks units and density

# [[term]]               # what may vary: see docs/matrices.md
# name = "plate"
# stiffness = {1}
# std = 0.1

[reduction]
band_Hz = "?"            # to be filled in: up to which frequency modes are wanted
"""


def _in_one(path: Path) -> tuple[str, str] | None:
    """Return the stiffness and the mass of a file that holds both as square arrays, by their names; None otherwise."""
    try:
        if kind_of(path) == ".mat":
            import scipy.io  # which `lamella new` does without as a rule

            shapes = {name: shape for name, shape, _ in scipy.io.whosmat(path)}
        else:
            with np.load(path, allow_pickle=False) as file:
                shapes = {name: file[name].shape for name in file.files if name[0] in "KkMmSs"}
    except Exception:  # a file that is no matrices; as a measurement it is looked at elsewhere
        return None
    square = [name for name, shape in shapes.items() if len(shape) == 2 and shape[0] == shape[1] > 1]
    k, m = (next((f"{path.name}#{n}" for n in square if re.match(p, n, re.IGNORECASE)), None) for p in ("k|stif", "m"))
    return (k, m) if k and m else None


def draft_structure(folder: Path) -> str | None:
    """Return a structure file for the matrices in a folder, with "?" where it is to be filled in; None without any.

    Parameters
    ----------
    folder : Path
        The folder.
    """
    names = sorted(path.name for path in folder.iterdir() if path.is_file())
    plain = {name: name.removesuffix(".gz") for name in names}

    def first(pattern: str) -> str | None:
        return next((name for name, text in plain.items() if re.search(pattern, text, re.IGNORECASE)), None)

    def one_of(kinds: Sequence[str]) -> str | None:
        return next((name for name in names if kind_of(Path(name)) in kinds), None)

    pair = next(((k, m) for k, m in ((first(a), first(b)) for a, b in _PAIRS) if k and m and k != m), None)
    full, punch = one_of((".full",)), one_of((".pch",))
    if pair is None and (full or punch):
        pair = (full, full) if full else (f"{punch}#KAAX", f"{punch}#MAAX")
    if pair is None:
        pair = next(filter(None, (_in_one(folder / name) for name in names if kind_of(Path(name)) in _ARRAYS)), None)
    if pair is None:
        return None
    labels = one_of(_LABELS) or next((name for name in names if name.lower() == "dofs.csv"), None)
    nodes = one_of(_NODES)
    rows = f"dofs = {json.dumps(labels)}   # node and direction of each row\n" if labels else ""
    if nodes:
        rows += f"nodes = {json.dumps(nodes)}   # where nodes are, and their sets\n"
    elif not labels:
        rows = '# nodes = "job.inp"   # to be filled in: where nodes are\n'
    stiffness, mass = map(json.dumps, pair)
    return _DRAFT.format(json.dumps(folder.resolve().name), stiffness, mass, rows)


def write_structure(folder: Path) -> Path | None:
    """Write the draft into its folder and return its path; None where there are no matrices, or a file is there.

    Raises
    ------
    MatricesError
        The folder cannot be read or written.
    """
    path = folder / FILE
    try:
        text = None if path.exists() or (folder / "stack.toml").exists() else draft_structure(folder)
        if text is None:
            return None
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        refuse(f"{folder}: cannot be read or written ({error.strerror})")
    return path
