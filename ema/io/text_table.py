"""A text file cut into its header and a table of its first numbers."""

from __future__ import annotations

import gzip
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.io.rows import (
    END_OF_HEADER,
    SEPARATORS,
    cells_of,
    decoded,
    encoding_of,
    is_labview,
    number,
    segments_of,
    ungrouped,
    unpacked,
)
from ema.types.errors import MeasurementError

_COMMENT = re.compile(r"^(#+|%+|;|//|\*(?!\*)) *")
DELIMITERS = ("tab", "semicolon", "comma", "space")  # in the order in which they are tried
FEWEST_ROWS = 10
"""Rows of numbers of a table; less is no measured function."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TextTable:
    """A text file cut into its header and a table of its first numbers."""

    encoding: str
    delimiter: str
    decimal: str
    header: list[list[str]]
    n_header: int
    heads: tuple[str, ...]  # the header of each segment; of LabVIEW's text, whose headers name no points, empty
    value: NDArray[np.complex128]

    def title(self, column: int) -> str:
        """All that the header says over a column."""
        width = self.value.shape[1]
        begin = max((k for k, row in enumerate(self.header) if row[0].startswith(END_OF_HEADER)), default=-1) + 1
        # a row of a header names what it states, "Time: 11:02", and a row of titles what is below it
        rows = [row for row in self.header[begin:] if not row[0].endswith(":") or row[-1].strip().endswith(":")]
        fits = [row for row in rows if len(row) == width or (len(row) == width + 1 and not row[-1].strip())]
        if not fits:  # a title more than there are numbers in all rows, such as that of a column of comments
            fits = [row for row in rows if len(row) > width and any(map(_is_word, row[:width]))][-1:]
        unit = self._labview_unit(fits[-1], column) if begin > 0 and fits else ""
        return " ".join(row[column].strip('" ') for row in fits).replace("_", " ").strip() + unit

    def _labview_unit(self, titles: list[str], column: int) -> str:
        """Return the unit of a column in brackets, which LabVIEW lists for channels, without their columns of times."""
        units = next((row[1:] for row in self.header if row[0] == "Y_Unit_Label"), [])
        channel = sum(title != "X_Value" for title in titles[: column + 1])
        is_time = titles[column] == "X_Value"
        return f" [{units[channel - 1].strip()}]" if 0 < channel <= len(units) and not is_time else ""

    @property
    def n_segment(self) -> int:
        """How many segments there are."""
        return len(self.heads)

    @property
    def words(self) -> str:
        """All of the header."""
        return "\n".join(" ".join(row) for row in self.header)


def _is_word(cell: str) -> bool:
    return bool(re.search(r"[^\W\d]{2}", cell))


def _has_unit(cell: str) -> bool:
    return bool(re.search(r"\w ?[\[(].+[\])]$", cell))


def rows_of(path: Path) -> tuple[list[str], str] | None:
    """Return the rows of a text file and its encoding; None where it cannot be read as text."""
    try:
        data = unpacked(path.read_bytes(), path.suffix)
    except (OSError, EOFError, gzip.zlib.error):  # type: ignore[attr-defined]
        return None
    encoding = encoding_of(data) or "utf-8"
    try:
        return decoded(data, encoding).splitlines(), encoding
    except UnicodeDecodeError:
        # where its first bytes tell another encoding, it cannot be read in it
        return (decoded(data, "latin-1").splitlines(), "latin-1") if encoding == "utf-8" else None


def cut_text(
    path: Path, *, fewest_rows: int = FEWEST_ROWS, looked_at: int = 400, most_header: int = 200
) -> TextTable | None:
    """Return a text file cut into header and numbers; None where it has no table of numbers.

    `looked_at`: rows of numbers that are read.
    """
    text = rows_of(path)
    if text is None:
        return None
    rows, encoding = text
    quoted = any('"' in row for row in rows[: most_header + looked_at])
    for delimiter, decimal in ((d, p) for d in DELIMITERS for p in ".,"):
        if (delimiter, decimal) == ("comma", ",") and not quoted:
            continue
        numbers = [numbers_of(row, delimiter, decimal) for row in rows[: most_header + looked_at]]
        for start in range(min(len(numbers), most_header)):
            width = len(numbers[start] or ())
            block = numbers[start : start + fewest_rows]
            if width > 1 and len(block) == fewest_rows and all(len(row or ()) == width for row in block):
                segments = segments_of(rows, start)
                last = start + len(segments[0].rows)
                value = [row for row in numbers[start:last] if row is not None and len(row) == width]
                _require_even(path, rows, numbers, start, delimiter)
                ends = [0, *(segment.first + len(segment.rows) for segment in segments)]
                heads = tuple(
                    "" if is_labview(rows[:start]) else "\n".join(rows[end : segment.first])
                    for end, segment in zip(ends, segments, strict=False)
                )
                # an empty row, and a "#" alone, has one empty cell, whatever separates the others
                header = [titles_of(row, delimiter) for row in rows[:start]]
                if header and len(words := rows[start - 1].split()) == width and all(map(_has_unit, words)):
                    header[-1] = words  # titles that are separated otherwise than the numbers
                return TextTable(
                    encoding=encoding, delimiter=delimiter, decimal=decimal, header=header, n_header=start,
                    heads=heads, value=np.array(value),
                )  # fmt: skip
    return None


def _require_even(path: Path, rows: list[str], numbers: list[list[complex] | None], start: int, delimiter: str) -> None:
    """Refuse a table whose first rows are of numbers, but for one that begins with a number and has other cells."""
    width = len(numbers[start] or ())
    first = cells_of(rows[start - 1], delimiter)[:1] if start > 1 else []
    if first and is_number(first[0]) and len(numbers[start - 2] or ()) == width:
        message = (
            f"{path}: row {start} has other cells than the {width} numbers of the rows beside it: "
            f"{rows[start - 1].strip()[:40]!r}; mend it"
        )
        raise MeasurementError(message)


def titles_of(row: str, delimiter: str) -> list[str]:
    """Return the cells of a row of a header, at least one; empty ones at its end are kept."""
    row = _uncommented(row)
    return (cells_of(row, delimiter) if '"' in row else row.split(SEPARATORS[delimiter])) or [""]


def _uncommented(row: str) -> str:
    """Return a row of a header without the sign of a comment before it: of NumPy, gnuplot, MATLAB, or an FRD file."""
    return _COMMENT.sub("", row)


def numbers_of(row: str, delimiter: str, decimal: str) -> list[complex] | None:
    """Return the numbers of a row, NaN for a first cell that is empty; None where another cell holds none."""
    cells = cells_of(row, delimiter)
    if len(cells) > 2 and not cells[0].strip():
        cells[0] = "nan"
    try:
        return [number(ungrouped(cell, decimal).replace(decimal, ".").strip()) for cell in cells]
    except ValueError:
        return None


def is_number(cell: str) -> bool:
    """Whether a cell holds a number."""
    try:
        number(cell)
    except ValueError:
        return False
    return True
