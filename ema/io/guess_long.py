"""How the columns of a text file seem to hold functions below each other, each row with its degrees of freedom."""

from __future__ import annotations

import re
from collections import defaultdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ema.io.contents import Code, Contents, dof_of_cells, polar_units, unit_in, volts_in
from ema.io.guess_table import OF_INPUT, functions_of
from ema.io.rows import DELIMITERS, FEWEST_ROWS, TextTable, cells_of, number, rows_of, titles_of

_OF_DOF = re.compile(r"point|node|\bdof|punkt|\bdir|\baxis|resp|\bout|\bref|\bexc|\binp|forc|sensor", re.IGNORECASE)
_CELL = re.compile(
    r"(?:[a-z]{1,6}[ _.]*)?\d{1,9}(?:\.0+)?[ :]*[+-]?[xyz]?[+-]?|[+-]?[xyz][+-]?|[+-]?[123]", re.IGNORECASE
)
"""What a cell of a DOF holds: a point, a direction, or both."""
_OF_FREQUENCY = re.compile(r"freq|\bhz\b|^f\b", re.IGNORECASE)
_Columns = dict[str, list[int]]


def guess_long(path: Path, *, most_header: int = 60) -> Contents | None:
    """Return what a text file holds whose columns state point and direction beside each frequency; else None."""
    text = rows_of(path) if _tells_of_dofs(path) else None
    rows, encoding = ([], "") if text is None else text
    for delimiter in DELIMITERS[:-1]:
        for k, row in enumerate(rows[:most_header]):
            titles = [title.strip("\"' ").replace("_", " ") for title in titles_of(row, delimiter)]
            frequency = [c for c, title in enumerate(titles) if _OF_FREQUENCY.search(title)]
            if len(titles) < 3 or len(frequency) != 1 or len(rows) < k + FEWEST_ROWS:
                continue
            cells = [[cell.strip("\"' ") for cell in cells_of(r, delimiter)] for r in rows[k + 1 :] if r.strip()]
            if any(len(c) != len(titles) for c in cells):
                continue
            header = [titles_of(r, delimiter) for r in rows[: k + 1]]
            found = _of_cells(titles, cells, frequency[0])
            if found is not None:
                keys, dofs, first, guesses = found
                keys |= {"delimiter": delimiter, "header_rows": k + 1, "encoding": encoding}
                return _described(path, header, keys, dofs, first, guesses)
    return None


def _tells_of_dofs(path: Path, *, looked_at: int = 10000) -> bool:
    """Whether the beginning of a file has words of points and of frequencies; reading all of others takes time."""
    if path.suffix == ".gz":
        return True
    with path.open("rb") as file:
        head = file.read(looked_at).replace(b"\0", b"").decode("latin-1").replace("_", " ")
    return bool(_OF_DOF.search(head) and _OF_FREQUENCY.search(head))


def _of_cells(
    titles: list[str], cells: list[list[str]], frequency: int
) -> tuple[dict[str, Any], list[tuple[Code | None, Code | None]], list[list[str]], list[str]] | None:
    """Return the keys of a table, its DOFs and the rows of the first of them; None where they are no functions."""
    columns = _dof_columns(titles, cells, frequency)
    if not columns.get("output"):
        return None
    places = [c for end in ("output", "input") for c in columns.get(end, [])]
    of_dof: dict[tuple[str, ...], list[list[str]]] = defaultdict(list)
    for row in cells:
        of_dof[tuple(row[c] for c in places)].append(row)
    split = len(columns["output"])
    alone = any(dof_of_cells(words[:split]) is None for words in of_dof)
    direction = "+z" if alone else ""
    dofs = [
        (dof_of_cells(words[:split], direction), dof_of_cells(words[split:], direction) if words[split:] else None)
        for words in of_dof
    ]
    if any(output is None or (columns.get("input") and force is None) for output, force in dofs):
        return None
    decimal = "," if any("," in row[frequency] for row in cells) else "."
    for of_one in of_dof.values():
        try:
            axis = [number(row[frequency].replace(decimal, ".")).real for row in of_one]
        except ValueError:
            return None
        if len(axis) < FEWEST_ROWS or not (
            all(a < b for a, b in pairwise(axis)) or all(a > b for a, b in pairwise(axis))
        ):
            return None
    keys: dict[str, Any] = {"decimal": decimal, "axis_column": frequency + 1, "direction": direction}
    keys |= {f"{end}_columns": [c + 1 for c in columns.get(end, [])] for end in ("output", "input")}
    guesses = ["points without a direction are taken along +z"] if direction else []
    first = next(iter(of_dof.values()))
    return keys, dofs, first, guesses


def _dof_columns(titles: list[str], cells: list[list[str]], frequency: int) -> _Columns:
    """Return the columns of point and direction of each end, the point first."""
    found: _Columns = defaultdict(list)
    for c, title in enumerate(titles):
        if c != frequency and _OF_DOF.search(title) and all(_CELL.fullmatch(row[c]) for row in cells):
            found["input" if re.search(OF_INPUT, title, re.IGNORECASE) else "output"].append(c)
    sure: _Columns = {}
    for end, columns in found.items():
        points = [c for c in columns if not re.search(r"\bdir|\baxis", titles[c], re.IGNORECASE)]
        directions = [c for c in columns if c not in points]
        if points:
            sure[end] = [points[0], *directions[:1]]
    return sure


def _described(
    path: Path,
    header: list[list[str]],
    keys: dict[str, Any],
    dofs: list[tuple[Code | None, Code | None]],
    first: list[list[str]],
    guesses: list[str],
) -> Contents | None:
    """Return the contents of a table of which the functions of one DOF are these rows; None where they are no FRFs."""
    taken = [c - 1 for c in (keys["axis_column"], *keys["output_columns"], *keys["input_columns"])]
    value = np.full((len(first), len(first[0])), np.nan, complex)
    for c in range(value.shape[1]):
        try:
            value[:, c] = [number(row[c].replace(keys["decimal"], ".")) for row in first]
        except ValueError:
            continue  # words
    text = TextTable(
        encoding=keys["encoding"], delimiter=keys["delimiter"], decimal=keys["decimal"], header=header,
        n_header=keys["header_rows"], heads=("",), value=value,
    )  # fmt: skip
    columns = [c for c in range(value.shape[1]) if c not in taken and not np.isnan(value[:, c]).all()]
    guessed = functions_of(text, columns, guesses)
    if guessed is None or len(guessed[1]) != 1:
        return None
    layout, groups, coherence = guessed
    keys |= {"columns": [[c + 1 for c in groups[0]]], "coherence_columns": [c + 1 for c in coherence]}
    if layout == "magnitude-phase":
        size, phase = (value[:, c].real for c in groups[0])
        keys |= polar_units((text.title(groups[0][0]), text.title(groups[0][1])), size, phase, guesses)
    usual = {"delimiter": "comma", "decimal": ".", "encoding": "utf-8"}
    keys = {key: v for key, v in keys.items() if v != usual.get(key) and v not in ([], "")}
    return Contents(
        file=path,
        section="table",
        keys={"layout": layout} | keys,
        unit=unit_in(text.words),
        odd_unit=volts_in(text.words),
        dofs=tuple(dofs),
        states=frozenset({"output"} | ({"input"} if "input_columns" in keys else set())),
        guesses=(*guesses, "each row states its DOF: rows of the same one are a function"),
    )
