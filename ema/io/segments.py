"""Segments of LabVIEW's text files (.lvm): one file, several records or functions, each below a header of its own."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

END_OF_HEADER = "***End_of_Header"
"""Ends the header of the file and that of each segment; the row of titles follows."""
_HEADER = re.compile(r"\s*($|\*\*\*|Channels\b|Samples\b|Date\b|Time\b|Y_|X_|X0\b|Delta_X\b|Notes\b|Test_)")
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


def segments_of(rows: Sequence[str], header_rows: int) -> list[Segment]:
    """Return the segments of a text file; one alone where it is not LabVIEW's, or has no further headers.

    Parameters
    ----------
    rows : sequence of str
        All rows of the file.
    header_rows : int
        Rows before the first row of numbers.
    """
    if not is_labview(rows[:header_rows]):
        return [Segment(rows=list(rows[header_rows:]), first=header_rows, start=0.0)]
    ends = [k for k, row in enumerate(rows) if k >= header_rows and row.startswith(END_OF_HEADER)]
    found, header = [], 0
    for first in (header_rows, *(end + 2 for end in ends)):  # titles stand between
        last = first
        while last < len(rows) and not _HEADER.match(rows[last]):
            last += 1
        if last > first:
            start = _start(rows[header:first])
            found.append(Segment(rows=list(rows[first:last]), first=first, start=start))
        header = last
    return found


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
