"""Files that a campaign file names: which ones there are, in which order, and what format they have."""

from __future__ import annotations

import difflib
import re
from pathlib import Path
from typing import Literal

from ema.types.errors import CampaignError

Format = Literal["uff", "csv", "mat", "hdf5", "numpy", "tdms", "wav"]
Names = tuple[str, ...] | tuple[tuple[str, ...], ...]
"""Names of files, or lists of names of which each gives files that belong side by side."""
SUFFIXES: dict[str, Format] = {
    **dict.fromkeys((".uff", ".unv", ".uf", ".uf3", ".ufb", ".bunv", ".uff58", ".univ"), "uff"),
    ".mat": "mat",
    **dict.fromkeys((".h5", ".hdf5", ".hdf", ".he5"), "hdf5"),
    **dict.fromkeys((".npy", ".npz"), "numpy"),
    ".tdms": "tdms",
    ".wav": "wav",
}  # fmt: skip
"""Formats by suffix; whatever has another one is text."""
_SHOWN = 60  # characters of a name that is none

NOT_READ = {
    ".frf": "a format of one program: export its FRFs as a universal file (58)",
    ".lms": "a format of one program: export its FRFs as a universal file (58)",
    ".pkl": "a Python object: write its arrays with numpy.savez",
    ".p": "a Python object: write its arrays with numpy.savez",
    ".xlsx": "a workbook: save its sheet as CSV",
    ".xls": "a workbook: save its sheet as CSV",
    ".zip": "an archive: unpack it",
}
"""What to do with files of measurements that are not read, by suffix."""


def format_of(file: Path, stated: Format | None = None) -> Format:
    """Return the format of a file: the stated one, else that of its suffix."""
    return stated or SUFFIXES.get(file.suffix.lower(), "csv")


def named_files(path: Path, folder: Path, key: str, patterns: tuple[str, ...]) -> tuple[Path, ...]:
    """Return the files of all patterns, those of one pattern in the natural order of their names.

    Parameters
    ----------
    path, folder : Path
        The campaign file, for messages, and the folder that names are relative to.
    key : str
        Key that names the files, for messages.
    patterns : tuple of str
        Names, which may hold wildcards.

    Raises
    ------
    CampaignError
        A pattern has no file; the message names those with similar names. Or it is no name that a file can have.
    """
    files: list[Path] = []
    for pattern in patterns:
        try:
            files += _named(path, folder, key, pattern)
        except OSError as error:  # such as a name that is too long
            message = f"{path}: {key}: {pattern[:_SHOWN]!r} names no file: {error.strerror}"
            raise CampaignError(message) from error
    return tuple(dict.fromkeys(files))


def files_beside(path: Path, folder: Path, key: str, patterns: tuple[str, ...]) -> list[Path]:
    """Return files of several patterns that hold channels of the same records: the first of each, the second of each.

    Raises
    ------
    CampaignError
        As `named_files`, or the patterns do not have as many files each, or one of them twice.
    """
    columns = [named_files(path, folder, key, (pattern,)) for pattern in patterns]
    counts = [len(column) for column in columns]
    if len(set(counts)) > 1 or len({f for column in columns for f in column}) < sum(counts):
        found = "; ".join(
            f"{pattern!r} is {', '.join(f.name for f in column[:3])}{', ...' if len(column) > 3 else ''} "
            f"({len(column)} files)"
            for pattern, column in zip(patterns, columns, strict=True)
        )
        message = f"{path}: {key}: of files side by side, in inner brackets, each name has as many, none twice: {found}"
        raise CampaignError(message)
    return [file for row in zip(*columns, strict=True) for file in row]


def _named(path: Path, folder: Path, key: str, pattern: str) -> list[Path]:
    """Return the files of one pattern."""
    if re.search(r"[*?\[]", pattern):
        anchor = Path(pattern).anchor
        found = list(Path(anchor).glob(pattern[len(anchor) :]) if anchor else folder.glob(pattern))
    else:
        found = [folder / pattern]
    found = sorted((f for f in found if f.is_file()), key=natural)
    if not found:
        there = [f.name for f in (folder / pattern).parent.glob("*")]
        if (folder / pattern).exists() and not (folder / pattern).is_dir():
            message = f"{path}: {key}: {pattern!r} is a pipe or a device; name plain files"
            raise CampaignError(message)
        close = difflib.get_close_matches(Path(pattern).name, there, n=2)
        hint = f"; did you mean {' or '.join(close)}?" if close else ""
        message = f"{path}: {key}: no file {pattern!r} in {folder}{hint}"
        raise CampaignError(message)
    return found


def natural(file: Path) -> list[tuple[int, str]]:
    """Return what sorts files as people count them, run 2 before run 10."""
    return [(int(p), "") if p.isdigit() else (0, p) for p in re.split(r"(\d+)", str(file))]
