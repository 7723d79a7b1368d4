"""Tables of modes as other programs write them, with the titles that `ema.io.found_modes` reads.

Programs call a natural frequency ``Frequency (Hz)``, ``fn`` or ``omega_n [rad/s]``, a damping ratio ``Damping [%]``,
``zeta`` or ``Loss factor``. A shape has a column for each degree of freedom, or a row: ``12Z+`` or a point and a
direction, and columns ``Mode 1``, or its parts.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from ema.io.contents import dof_name, dofs_in

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
    dofs = [_dof(*cells) for cells in zip(columns[point], beside, strict=True)]
    if any(dof is None for dof in dofs):
        return None
    codes = [dof for dof in dofs if dof is not None]
    shapes: Columns = {"node": [str(node) for node, _ in codes]}
    for k, axis in enumerate("xyz"):
        shapes[axis] = [str(int(np.sign(code)) if abs(code) == k + 1 else 0) for _, code in codes]
    for title, match in modes.items():
        shapes[f"mode_{match[1]}_{_part(title[match.end() :])}"] = columns[title]
    return _joined(shapes, decimal)


def _dof(cell: str, direction: str) -> tuple[int, int] | None:
    """Return the DOF that a cell holds, perhaps with a direction in a cell beside it."""
    axis = re.fullmatch(r"([+-]?)([xyz123])([+-]?)", direction.strip().casefold()) if direction else None
    if direction and axis is None:
        return None
    if axis is not None and re.fullmatch(r"\d{1,9}(\.0*)?", cell):
        code = "xyz123".index(axis[2]) % 3 + 1
        return int(float(cell)), -code if "-" in (axis[1], axis[3]) else code
    dofs = dofs_in(cell)
    return dofs[0] if len(dofs) == 1 else None


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
