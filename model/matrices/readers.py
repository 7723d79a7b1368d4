"""Readers of matrices that other programs write: CalculiX, Abaqus, Nastran, Ansys, Matrix Market, npz and MATLAB."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
import scipy
import scipy.sparse as sp
from numpy.typing import NDArray

from model.matrices.labelled import DIRECTIONS, Index, Labelled, labelled
from model.matrices.text import columns_of_csv, kind_of, numbers, read_text, refuse

Target = Literal["M", "C", "K"]

_ANSYS = ("ux", "uy", "uz", "rotx", "roty", "rotz")
_DOFS = {word: i for i, words in enumerate(zip(DIRECTIONS, _ANSYS, strict=True), 1) for word in words}
_NASTRAN = {"K": ("KAAX", "KGGX", "KAA", "KGG"), "M": ("MAAX", "MGGX", "MAA", "MGG"), "C": ("BAAX", "BAA", "BGG")}


def read_matrix(given: str, folder: Path, target: Target, labels: Path | None) -> Labelled:
    """Read one matrix.

    Parameters
    ----------
    given : str
        The file, followed by `#NAME` where it holds several matrices.
    folder : Path
        Where it is.
    target : "M", "C" or "K"
        What it is: which of several matrices is taken where no name is given.
    labels : Path, optional
        File of the labels of the rows, for programs that keep them apart.

    Raises
    ------
    MatricesError
        The file cannot be read, or as in `labelled`; the message says what would be right.
    """
    file, _, name = given.partition("#")
    path, kind = folder / file, kind_of(Path(file))
    if kind in _TEXT:
        return _TEXT[kind](path, name, target)
    if kind == ".full":
        return _full(path, target)
    if kind in (".npz", ".mat"):
        return _square(path, _array(path, name), labels)
    if kind in (".sti", ".mas", ".dam"):
        form = "row column value, as CalculiX writes with *FREQUENCY, SOLVER=MATRIXSTORAGE"
        table = numbers(path, read_text(path, ended=True), 3, form)
        beside = path.with_name(path.name.replace(kind, ".dof"))
        plain = beside.with_name(beside.name.removesuffix(".gz"))
        return _entries(path, table, labels or (beside if beside.exists() else plain))
    if kind not in (".mtx", ".mmf"):
        known = ".sti .mas (CalculiX), .mtx (Abaqus, Matrix Market), .pch (Nastran), .mmf .full (Ansys), .npz, .mat"
        refuse(f"{path}: the suffix says no program; known are {known}, each also with .gz")
    text = read_text(path, ended=True)
    if not text.startswith("%%MatrixMarket"):
        return _abaqus(path, text)
    try:
        matrix = sp.coo_matrix(scipy.io.mmread(io.StringIO(text)))
    except (ValueError, TypeError, OverflowError) as error:
        refuse(f"{path}: not a Matrix Market file: {error}")
    return _square(path, matrix, labels)


def read_labels(path: Path) -> Index:
    """Read the labels of rows, (n, 2): `.dof` of CalculiX, `.mapping` of Ansys, or CSV with columns node and dof.

    Matrices of a structure share them, so they are read once.

    Raises
    ------
    MatricesError
        A line holds something else.
    """
    return _labels_of(path, path.stat().st_mtime_ns if path.exists() else 0)


@lru_cache(maxsize=2)
def _labels_of(path: Path, changed: int) -> Index:  # noqa: ARG001
    if kind_of(path) == ".csv":
        words, form = columns_of_csv(path, ("node", "dof")), "12,3 or 12,z"
    elif kind_of(path) == ".mapping":
        lines = [line.split() for line in read_text(path).splitlines() if line[:12].strip().isdigit()]
        words = [[one[k] if len(one) == 3 else " ".join(one) for one in lines] for k in (1, 2)]
        form = "equation node UX, as HBMAT writes"
    else:
        parts = [one.partition(".") for one in read_text(path).split()]
        words, form = [[one[k] for one in parts] for k in (0, 2)], "node.direction, such as 12.3"
    found = []
    for i, (node, word) in enumerate(zip(*words, strict=True), 1):
        try:
            found.append((int(node), _DOFS.get(word.strip().lower()) or int(word)))
        except ValueError:
            refuse(f"{path}: label {i} is {(node, word)!r}; it must be: {form}")
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def _entries(path: Path, table: NDArray[np.float64], labels: Path | None, n_row: int | None = None) -> Labelled:
    """Return the matrix of a table of row, column (from 1) and value, of `n_row` rows, with labels from their file."""
    if labels is None:
        refuse(f'{path}: says no nodes; name the table of its rows, such as dofs = "dofs.csv" with node,dof,x,y,z')
    label = read_labels(labels)
    row, column = (table[:, i].astype(np.int64) - 1 for i in (0, 1))
    every = np.append(row, column) + 1
    lowest, highest = int(every.min(initial=1)), int(every.max(initial=1))
    if lowest < 1 or highest > len(label) or n_row not in (None, len(label)):
        refuse(
            f"{path}: has rows {lowest} to {n_row or highest}, and {labels} labels 1 to {len(label)}; they do not match"
        )
    return labelled(str(path), label, row, column, table[:, 2])


def _square(path: Path, matrix: sp.coo_matrix, labels: Path | None) -> Labelled:
    """Return a square matrix with labels from their file."""
    if matrix.shape[0] != matrix.shape[1] or np.iscomplexobj(matrix.data):
        what = "complex" if np.iscomplexobj(matrix.data) else f"{matrix.shape[0]} by {matrix.shape[1]}"
        refuse(f"{path}: the matrix is {what}; a real square one is needed")
    table = np.column_stack([matrix.row + 1, matrix.col + 1, matrix.data])
    return _entries(path, table, labels, matrix.shape[0])


def _array(path: Path, name: str) -> sp.coo_matrix:
    """Return a matrix of an npz file (of `scipy.sparse.save_npz`, or dense by name) or of a MATLAB file."""
    try:
        if kind_of(path) == ".mat":
            arrays = {k: v for k, v in scipy.io.loadmat(path).items() if not k.startswith("__")}
        else:
            with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
                arrays = {k: file[k] for k in file.files}
            if "format" in arrays:
                arrays = {name: sp.load_npz(path)}
        for array in arrays.values():
            if hasattr(array, "check_format"):  # of a sparse matrix; conversions trust its indices, and crash
                array.check_format(full_check=True)
    except Exception as error:  # a damaged file brings forth any, of zip, of its compression, of the reader
        hint = "; save it with -v7, not -v7.3" if isinstance(error, NotImplementedError) else ""
        refuse(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error}{hint})")
    if not name and len(arrays) == 1:
        name = next(iter(arrays))
    if name not in arrays or np.ndim(arrays[name]) != 2:
        refuse(f"{path}: holds no matrix {name!r}; name one of {', '.join(sorted(arrays))} as {path.name}#NAME")
    matrix = arrays[name]
    kept = matrix if sp.issparse(matrix) else np.asarray(matrix)
    return sp.coo_matrix(kept.astype(complex if np.iscomplexobj(kept) else float))


def _from_pairs(path: Path, table: NDArray[np.float64]) -> Labelled:
    """Return the matrix of a table of node, degree of freedom, node, degree of freedom, value."""
    pairs = table[:, :4].astype(np.int64)
    labels, number = np.unique(np.concatenate([pairs[:, :2], pairs[:, 2:]]), axis=0, return_inverse=True)
    row, column = number.reshape(2, -1)
    return labelled(str(path), labels, row, column, table[:, 4])


def _abaqus(path: Path, text: str) -> Labelled:
    """Read `*MATRIX OUTPUT, FORMAT=MATRIX INPUT`: node, dof, node, dof, value."""
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("*")]
    form = "node, dof, node, dof, value, as Abaqus writes with *MATRIX OUTPUT, FORMAT=MATRIX INPUT"
    table = numbers(path, "\n".join(lines) or "none", 5, form, delimiter=",")
    return _from_pairs(path, table)


def _nastran(path: Path, name: str, target: Target) -> Labelled:
    """Read DMIG cards of a punch file, in fields of 8, of 16 (`DMIG*`), or between commas."""
    found: dict[str, tuple[str, str, list[tuple[int, int, int, int, float]]]] = {}  # form, kind of numbers, entries
    current, column = "", (0, 0)
    for number, line in enumerate(read_text(path, ended=True).splitlines(), 1):
        if not line.strip() or line.startswith("$"):
            continue
        fields = _fields(line)
        try:
            if fields[0].rstrip("*").upper() == "DMIG":
                current = fields[1].upper()
                if fields[2] == "0" and current not in found:
                    found[current] = (fields[3], fields[4], [])
                    continue
                column, rest = (int(fields[2]), int(fields[3] or 0)), fields[5:]
            elif fields[0].rstrip("*") in ("", "+") or fields[0].startswith(("*", "+")):
                rest = fields[1:]
            else:
                current = ""
                continue
            if not current:
                continue
            while len(rest) >= 3 and rest[0]:
                found[current][2].append((int(rest[0]), int(rest[1] or 0), *column, _real(rest[2])))
                rest = rest[4:]
        except (ValueError, IndexError, KeyError):
            refuse(f"{path}: line {number} is no card DMIG of a real matrix: {line.strip()!r}")
    wanted = [name.upper()] if name else [one for one in _NASTRAN[target] if one in found]
    if not wanted or wanted[0] not in found:
        refuse(f"{path}: holds no matrix {name or target}; there are {', '.join(found) or 'none'}")
    form, numbers_are, table = found[wanted[0]]
    if form not in ("1", "6") or not table:
        refuse(f"{path}: matrix {wanted[0]} has form {form}; a filled square (1) or symmetric (6) one is needed")
    if numbers_are in ("3", "4"):
        refuse(
            f"{path}: matrix {wanted[0]} is complex; write it without structural damping (PARAM,G and GE), for a real "
            "one is needed"
        )
    return _from_pairs(path, np.array(table))


def _fields(line: str) -> list[str]:
    """Return the fields of a Nastran card, the first one its name."""
    if "," in line:
        return [one.strip() for one in line.split(",")]
    width = 16 if "*" in line[:8] else 8
    line = line.expandtabs().rstrip()[: 8 + 64]
    return [line[:8].strip(), *(line[i : i + width].strip() for i in range(8, len(line), width)), ""]


def _real(word: str) -> float:
    """Return a number, also as a Nastran card has it, such as 1.5D+3 or 1.5+3."""
    try:
        return float(word)
    except ValueError:
        return float(re.sub(r"(?<=[\d.])([+-]\d+)$", r"E\1", word.upper().replace("D", "E")))


def _full(path: Path, target: Target) -> Labelled:
    """Read a `.full` file of Ansys through ansys-mapdl-reader, if that is installed."""
    full = {"K": 1, "M": 2}  # place of a matrix in what ansys-mapdl-reader returns
    try:
        from ansys.mapdl.reader import read_binary  # an extra
    except ImportError:
        refuse(
            f"{path}: .full files need ansys-mapdl-reader, which pip install 'lamella[ansys]' brings; or write text "
            "with *EXPORT, MMF"
        )
    try:
        whole = read_binary(str(path)).load_km(sort=False)
        label, matrix = np.asarray(whole[0]), sp.coo_matrix(whole[full[target]])
    except (OSError, ValueError, RuntimeError, KeyError, AttributeError) as error:
        refuse(f"{path}: holds no {target} that ansys-mapdl-reader can read ({error})")
    row, column = (one.astype(np.int64) for one in (matrix.row, matrix.col))
    return labelled(str(path), label[:, :2].astype(np.int64) + np.array([0, 1]), row, column, matrix.data)


_TEXT: dict[str, Callable[[Path, str, Target], Labelled]] = {".pch": _nastran, ".dmig": _nastran}
