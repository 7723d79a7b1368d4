"""Rows of text tables: bytes to text, header and first numbers, rows to cells, and segments of LabVIEW (.lvm)."""

from __future__ import annotations

import codecs
import csv
import gzip
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ema.types.errors import MeasurementError
from lamella_shared import Complexes

SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "space": None}
"""What separates columns, by its name; None is any amount of blanks and tabs."""
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),  # before UTF-16, whose mark it begins with
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[+-]?\d)")
_WITHOUT_LETTER = re.compile(r"(\.\d+)([+-]\d{3})(?=$|[\s,;])")
"""An exponent of three digits takes the place of Fortran's letter, as in ``1.5-103``."""
_NO_NUMBER = re.compile(
    r"[+-]?(?:1\.#(?:Q?NAN|SNAN|IND)\w*|nan\(\w*\)|n\.?def\.?|undefined)|#(?:N/?A|NV|NUM!|ZAHL!|DIV/0!|VALUE!|WERT!)",
    re.IGNORECASE,
)
"""What Microsoft's C library, spreadsheets and MATLAB's neighbours write in place of a number that is none."""
_INFINITE = re.compile(r"([+-]?)1\.#INF\w*", re.IGNORECASE)
_TIME_OF_DAY = re.compile(
    r"(?:\d{1,4}[-./]\d{1,2}[-./]\d{1,4}[T ]+)?(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+)?)(?:Z|[+-]\d\d:?\d\d)?"
)
"""A time as recorders write it, ``10:15:20.001`` or ``2021-03-01T10:15:20.001``; the day does not matter."""
_QUOTED = re.compile(r'"([^"]*)"|(\S+)')


def unpacked(data: bytes, suffix: str) -> bytes:
    """Return the bytes of a file, which ``.gz`` packs.

    Raises
    ------
    OSError, EOFError, zlib.error
        They cannot be unpacked.
    """
    return gzip.decompress(data) if suffix == ".gz" else data


def encoding_of(data: bytes, *, looked_at: int = 1000) -> str | None:
    """Return the encoding that a file's first bytes tell: a mark of the byte order, or UTF-16 without one.

    `looked_at`: bytes from which the encoding is seen.
    """
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return encoding
    head = data[: looked_at // 2 * 2]
    even, odd = head[::2].count(0), head[1::2].count(0)
    if len(head) > 1 and max(even, odd) > 0.4 * len(head) and min(even, odd) == 0:
        return "utf-16-le" if odd > even else "utf-16-be"
    return None


def decoded(data: bytes, encoding: str) -> str:
    """Return the text of a file in its stated encoding; what its first bytes tell comes first.

    Raises
    ------
    ValueError, LookupError
        The bytes are no text in this encoding, or there is none of that name.
    """
    return data.decode(encoding_of(data) or encoding).removeprefix("\ufeff")


def cells_of(row: str, delimiter: str) -> list[str]:
    """Return the cells of a row, without those that are empty at its end; quotes hold a cell together.

    Parameters
    ----------
    row : str
    delimiter : {"comma", "semicolon", "tab", "space"}
    """
    separator = SEPARATORS[delimiter]
    cells = _quoted(row, separator) if '"' in row else row.split(separator)
    while cells and not cells[-1].strip():  # a delimiter that ends the row opens no column
        cells.pop()
    return cells


def _quoted(row: str, separator: str | None) -> list[str]:
    if row.count('"') % 2:  # a quote that nobody closes, such as one for inches
        return row.split(separator)
    if separator is None:
        return [quoted or plain for quoted, plain in _QUOTED.findall(row)]
    try:
        return next(csv.reader([row], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:  # such as a cell without end
        return row.split(separator)


def plain_rows(rows: Sequence[str], delimiter: str, decimal: str) -> list[str]:
    """Return rows of numbers without quotes and groups of thousands, with decimal points, and with e before exponents.

    ``1'234.5`` and ``1 234,5`` with a narrow blank are grouped wherever they stand. ``1,234`` is where the decimal mark
    is a point and a number such as ``1,234.5`` is among the rows, for else it may be a decimal comma.
    """
    separator = SEPARATORS[delimiter]
    other = "." if decimal == "," else ","
    both = re.compile(rf"\d\{other}\d{{3}}\{decimal}\d")
    marks = "'’" if separator is None else "'’\u00a0\u202f"
    quoted = grouped = marks
    if any(other in row and both.search(row) for row in rows):
        quoted = marks + other
        grouped = marks if separator == other else quoted
    plain = []
    for row in rows:
        if '"' in row:
            cells = (ungrouped(c, decimal, quoted).replace(decimal, ".") for c in cells_of(row, delimiter))
            row = (separator or " ").join(cells)  # noqa: PLW2901
        else:
            row = ungrouped(row, decimal, grouped)  # noqa: PLW2901
            if decimal == "," and separator != ",":
                row = row.replace(",", ".")  # noqa: PLW2901
        plain.append(_with_letter(row))
    return plain


def ungrouped(text: str, decimal: str, marks: str | None = None) -> str:
    """Return a text without the marks that hold thousands of its numbers apart.

    Where they are not given, point and comma are such marks beside the decimal one alone.
    """
    if marks is None:
        marks = "'’\u00a0\u202f" + (".," if decimal in text else "")
    separators = "".join(mark for mark in marks if mark in text and mark != decimal)
    if not separators:
        return text
    apart = f"[{re.escape(separators)}]"
    number_ = rf"(?<![\d{re.escape(separators + decimal)}])[1-9]\d{{0,2}}(?:{apart}\d{{3}})+(?!\d)"
    return re.sub(number_, lambda match: re.sub(apart, "", match[0]), text)


def _with_letter(text: str) -> str:
    """Return a text in which the exponents of numbers begin with e."""
    if "D" in text or "d" in text:
        text = _FORTRAN.sub("e", text)
    return _WITHOUT_LETTER.sub(r"\1e\2", text) if "+" in text or "-" in text else text


def number(word: str) -> complex:
    """Return the number that a cell holds, real or complex, of a time of day its seconds; a ValueError without one."""
    if ":" in word and (clock := _TIME_OF_DAY.fullmatch(word.strip("\"' "))) is not None:
        hours, minutes, seconds = clock.groups()
        return complex(3600 * int(hours) + 60 * int(minutes) + float(seconds.replace(",", ".")))
    compact = word.replace(" ", "").strip("()\"'")
    # "i" alone, and not that of "inf", is the other spelling of the imaginary unit
    compact = compact[:-1] + "j" if compact.endswith(("i", "I", "J")) else compact
    try:
        return complex(compact)
    except ValueError:
        if _NO_NUMBER.fullmatch(word.strip("\"' ")):
            return complex("nan")
        if (infinite := _INFINITE.fullmatch(word.strip("\"' "))) is not None:
            return complex(infinite[1] + "inf")
        return complex(_with_letter(compact.replace("+-", "-")))


END_OF_HEADER = "***End_of_Header"
"""Ends the header of the file and that of each segment; the row of titles follows."""
_HEADER = re.compile(r"\s*($|\*\*\*|Channels\b|Samples\b|Date\b|Time\b|Y_|X_|X0\b|Delta_X\b|Notes\b|Test_)")
_FIRST_CELL = re.compile(r"""\s*["'(]?([+-]?[.,]?\d[^\s;,"']*)""")
_APART = re.compile(r"[\s;,]+")
_CLOCK = re.compile(r"(\d+):(\d+):(\d+(?:[.,]\d+)?)")


@dataclass(frozen=True, kw_only=True)
class Segment:
    """Rows of numbers of a segment, where the first of them stands in the file, from 0, and when it begins, s."""

    rows: list[str]
    first: int
    start: float


def is_labview(rows: Sequence[str]) -> bool:
    """Whether the header of a text file is one of LabVIEW's."""
    return any(row.startswith(END_OF_HEADER) for row in rows)


def first_row(rows: Sequence[str], header_rows: int) -> int:
    """Return the first row of numbers: the one after the header, or a later one where more of a header stands there.

    Headers of files of one set may differ in length; rows before `header_rows` are none of numbers in any of them.
    """
    if header_rows >= len(rows) or not _is_of_header(rows[header_rows]):
        return header_rows
    firsts: Iterable[int] = range(header_rows, len(rows))
    if is_labview(rows):
        firsts = (k + 2 for k, row in enumerate(rows) if row.startswith(END_OF_HEADER))
    later = (k for k in firsts if header_rows < k < len(rows) and not _is_of_header(rows[k]))
    return next(later, header_rows)


def _is_of_header(row: str) -> bool:
    """Whether the first cell of a row that is not empty is no number, and begins with no digit."""
    row = row.lstrip(" \t;,")
    if _FIRST_CELL.match(row):
        return False
    cells = _APART.split(row)
    try:
        number(cells[0])
    except ValueError:
        return True
    return False


def segments_of(rows: Sequence[str], header_rows: int, *, fewest: int = 10) -> list[Segment]:
    """Return the segments of a text file; one alone where it has no further headers.

    In LabVIEW's text each header begins a segment. In that of others a header stands between them, and each begins with
    the abscissa and the width of the first; words below the numbers, or amidst them, are none.

    Parameters
    ----------
    rows : sequence of str
        All rows of the file.
    header_rows : int
        Rows before the first row of numbers.
    fewest : int
        Rows of numbers of a segment.
    """
    if not is_labview(rows[:header_rows]):
        firsts = [header_rows, *_begun_anew(rows, header_rows, fewest)]
        heads = [header_rows, *(_header_of(rows, first) for first in firsts[1:]), len(rows)]
        return [
            Segment(rows=list(rows[first:head]), first=first, start=0.0)
            for first, head in zip(firsts, heads[1:], strict=True)
        ]
    ends = [k for k, row in enumerate(rows) if k >= header_rows and row.startswith(END_OF_HEADER)]
    segments, header = [], 0
    for first in (header_rows, *(end + 2 for end in ends)):  # titles stand between
        last = first
        while last < len(rows) and not _HEADER.match(rows[last]):
            last += 1
        if last > first:
            start = _start(rows[header:first])
            segments.append(Segment(rows=list(rows[first:last]), first=first, start=start))
        header = last
    return segments


def _begun_anew(rows: Sequence[str], header_rows: int, fewest: int) -> list[int]:
    """Return the rows after further headers at which numbers begin as the first do."""
    if header_rows >= len(rows) or (first := _FIRST_CELL.match(rows[header_rows])) is None:
        return []
    width = len(_APART.findall(rows[header_rows].strip()))
    firsts, in_header = [], False
    for k in range(header_rows + 1, len(rows)):
        cell = _FIRST_CELL.match(rows[k])
        if cell is None:
            in_header = True
            continue
        block = rows[k : k + fewest]
        if in_header and cell[1] == first[1] and len(block) == fewest:
            alike = all(_FIRST_CELL.match(row) and len(_APART.findall(row.strip())) == width for row in block)
            firsts += [k] if alike else []
        in_header = False
    return firsts


def _header_of(rows: Sequence[str], first: int) -> int:
    """Return the first row of the header before a segment: what follows the last row of numbers."""
    while _FIRST_CELL.match(rows[first - 1]) is None:
        first -= 1
    return first


def _start(header: Sequence[str]) -> float:
    """Return when a segment begins by its header, s after midnight: its clock and its first abscissa."""
    start = 0.0
    of_segment = [k for k, row in enumerate(header) if row.startswith("Channels")]
    for row in header[of_segment[-1] if of_segment else 0 :]:
        words = row.split("\t" if "\t" in row else ",")
        if len(words) > 1 and words[0] == "Time" and (clock := _CLOCK.match(words[1].strip())) is not None:
            hours, minutes, seconds = clock.groups()
            start += 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds.replace(",", "."))
        if len(words) > 1 and words[0] == "X0":
            try:
                start += float(words[1].replace(",", "."))
            except ValueError:
                continue
    return start


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
    value: Complexes

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
        separator, first = SEPARATORS[delimiter], most_header + fewest_rows  # numbers begin in these rows, or nowhere
        if separator is not None and not any(separator in row for row in rows[:first]):
            continue
        numbers = [numbers_of(row, delimiter, decimal) for row in rows[:first]]
        for start in range(min(len(numbers), most_header)):
            width = len(numbers[start] or ())
            block = numbers[start : start + fewest_rows]
            if width > 1 and len(block) == fewest_rows and all(len(row or ()) == width for row in block):
                numbers += [numbers_of(row, delimiter, decimal) for row in rows[first : most_header + looked_at]]
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
        raise MeasurementError(
            f"{path}: row {start} has other cells than the {width} numbers of the rows beside it: "
            f"{rows[start - 1].strip()[:40]!r}; correct it"
        )


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
