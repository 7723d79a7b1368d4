"""Where nodes are, and which sets they form, read from the decks of other programs."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model.matrices.labelled import Index
from model.matrices.readers import _fields, _real
from model.matrices.text import kind_of, read_text, rows_of_csv
from model.stack.errors import MatricesError


@dataclass(frozen=True, eq=False, kw_only=True)
class Nodes:
    """Nodes of a mesh.

    Attributes
    ----------
    number : (n,) int
        Their numbers, ascending.
    location : (n, 3) float
        Where they are, in the units of the file.
    sets : dict of str to (m,) int
        Their named sets, names in capitals.
    """

    number: Index
    location: NDArray[np.float64]
    sets: dict[str, Index]

    def at(self, wanted: Index) -> Index:
        """Return the rows of nodes.

        Raises
        ------
        KeyError
            A node is missing.
        """
        where = np.minimum(np.searchsorted(self.number, wanted), max(self.number.size - 1, 0))
        missing = self.number[where] != wanted if self.number.size else np.ones(len(wanted), dtype=bool)
        if missing.any():
            raise KeyError(int(np.asarray(wanted)[np.argmax(missing)]))
        return np.asarray(where)


def read_nodes(path: Path) -> Nodes:
    """Read nodes: `.inp` (CalculiX, Abaqus), `.bdf` `.dat` `.nas` (Nastran), `.cdb` (Ansys) or CSV with node,x,y,z.

    Raises
    ------
    MatricesError
        There are none, or one of them is not as it should be.
    """
    kind = kind_of(path)
    sets: dict[str, list[int]] = {}
    if kind == ".csv":
        table = {}
        for i, one in enumerate(rows_of_csv(path, ("node", "x", "y", "z")), 2):
            table[_whole(path, i, one["node"] or "")] = _place(path, i, [one[axis] or "" for axis in "xyz"])
    elif kind in (".bdf", ".dat", ".nas"):
        table = _grids(path)
    elif kind == ".cdb":
        table = _nblock(path)
    else:
        table, sets = _deck(path)
    if not table:
        message = f"{path}: holds no nodes; *NODE, GRID, NBLOCK or a CSV table with node,x,y,z is needed"
        raise MatricesError(message)
    number = np.array(sorted(table), dtype=np.int64)
    return Nodes(
        number=number,
        location=np.array([table[int(i)] for i in number]),
        sets={name: np.unique(np.array(own, dtype=np.int64)) for name, own in sets.items()},
    )


def _whole(path: Path, line: int, word: str) -> int:
    try:
        return int(word)
    except ValueError as error:
        message = f"{path}: line {line}: {word!r} is no node number"
        raise MatricesError(message) from error


def _place(path: Path, line: int, words: list[str]) -> tuple[float, ...]:
    try:
        found = tuple(_real(word) if word.strip() else 0.0 for word in (*words, "", "", "")[:3])
    except ValueError as error:
        message = f"{path}: line {line}: {', '.join(words)} are no coordinates"
        raise MatricesError(message) from error
    return found


def _deck(path: Path) -> tuple[dict[int, tuple[float, ...]], dict[str, list[int]]]:
    """Read *NODE and *NSET of a deck of CalculiX or Abaqus without parts, and the files that it includes."""
    table: dict[int, tuple[float, ...]] = {}
    sets: dict[str, list[int]] = {}
    keyword, options = "", {}
    for i, line in enumerate(read_text(path).splitlines(), 1):
        words = [one.strip() for one in line.split(",")]
        if line.startswith("**") or not line.strip():
            continue
        if line.startswith("*"):
            keyword = words[0].upper()
            options = {
                k.strip().upper(): v.strip().upper() for k, _, v in (one.partition("=") for one in words[1:])
            }
            name = options.get("NSET", "")
            if keyword == "*INCLUDE":
                further, more = _deck(path.parent / dict(_pairs(words[1:]))["INPUT"])
                table.update(further)
                sets.update(more)
        elif keyword == "*NODE":
            table[_whole(path, i, words[0])] = _place(path, i, words[1:])
            if name:
                sets.setdefault(name, []).append(int(words[0]))
        elif keyword == "*NSET":
            sets.setdefault(name, []).extend(_members(path, i, words, "GENERATE" in options, sets))
    return table, sets


def _pairs(words: list[str]) -> list[tuple[str, str]]:
    return [(k.strip().upper(), v.strip().strip('"')) for k, _, v in (one.partition("=") for one in words)]


def _members(
    path: Path, line: int, words: list[str], generate: bool, sets: dict[str, list[int]]
) -> list[int]:
    """Return the nodes of a line of *NSET: numbers, names of other sets, or first, last and step."""
    if generate:
        first, last, *step = (_whole(path, line, word) for word in words if word)
        return list(range(first, last + 1, *(step or [1])))
    found: list[int] = []
    for word in filter(None, words):
        found.extend(sets[word.upper()] if word.upper() in sets else [_whole(path, line, word)])
    return found


def _grids(path: Path) -> dict[int, tuple[float, ...]]:
    """Read GRID and GRID* of a Nastran deck, in basic coordinates."""
    table: dict[int, tuple[float, ...]] = {}
    lines = read_text(path).splitlines()
    for i, line in enumerate(lines):
        if not re.match(r"GRID[ ,*]", line.upper()):
            continue
        fields = _fields(line)
        if fields[0].upper() == "GRID*" and i + 1 < len(lines):
            fields = [*fields[:5], *_fields(lines[i + 1])[1:]]
        if fields[2] not in ("", "0") or (len(fields) > 6 and fields[6] not in ("", "0")):
            message = f"{path}: line {i + 1}: grid {fields[1]} has a coordinate system; only basic coordinates are read"
            raise MatricesError(message)
        table[_whole(path, i + 1, fields[1])] = _place(path, i + 1, fields[3:6])
    return table


def _nblock(path: Path) -> dict[int, tuple[float, ...]]:
    """Read the NBLOCK of an Ansys archive (CDWRITE)."""
    table: dict[int, tuple[float, ...]] = {}
    lines = iter(enumerate(read_text(path).splitlines(), 1))
    for _, line in lines:
        if not line.upper().startswith("NBLOCK"):
            continue
        form = re.match(r"\s*\((\d+)i(\d+),\d+e(\d+)", next(lines, (0, ""))[1].lower())
        if form is None:
            message = f"{path}: NBLOCK without its format, such as (3i9,6e21.13e3)"
            raise MatricesError(message)
        n, wide, long = (int(one) for one in form.groups())
        for i, own in lines:
            if own.lstrip().startswith(("N,", "-1")):
                break
            start = n * wide
            places = [own[start + k * long : start + (k + 1) * long] for k in range(3)]
            table[_whole(path, i, own[:wide])] = _place(path, i, places)
    return table
