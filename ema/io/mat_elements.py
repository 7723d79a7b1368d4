"""Elements of MATLAB files of version 5 to 7.2: whether they fit into each other.

SciPy's reader looks up the type of an element in a table without asking whether it is in it, so that a file which
lost some bytes ends the whole process instead of raising an error. So their tags are walked through before.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import BinaryIO

_HEADER = 128  # bytes before the first element
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = frozenset((1, 2, 3, 4, 5, 6, 7, 9, 12, 13))
_TEXT = frozenset((16, 17, 18))
_NUMERIC_CLASSES = range(6, 16)
_DEEPEST = 30  # structures in structures


def check_elements(path: Path) -> None:
    """Walk through all elements that are not compressed; those carry a checksum.

    Parameters
    ----------
    path : Path
        MATLAB file of version 5 to 7.2.

    Raises
    ------
    ValueError
        An element has an unknown type, or is longer than what it is in; the message says at which byte.
    """
    with path.open("rb") as file:
        order = ">" if file.read(_HEADER)[-2:] == b"MI" else "<"
        _check(file, _HEADER, os.fstat(file.fileno()).st_size, order, 0)


def _check(file: BinaryIO, position: int, end: int, order: str, depth: int) -> None:
    """Check the elements between two positions of a file; below the top they are the parts of one matrix."""
    numeric = False
    first = True
    while position + 8 <= end:
        file.seek(position)
        tag = file.read(16)
        kind, size = struct.unpack(f"{order}II", tag[:8])
        start = position + 8
        if kind >> 16:  # up to four bytes that stand in the tag itself
            kind, size, start = kind & 0xFFFF, kind >> 16, position + 4
            stop = position + 8
        else:
            stop = start + size + (-size % 8 if kind != _COMPRESSED else 0)
        expected = (
            {_MATRIX, _COMPRESSED} if depth == 0 else _NUMBERS if numeric else _NUMBERS | _TEXT | {_MATRIX}
        )
        if kind not in expected or start + size > end or depth > _DEEPEST:
            message = f"the element at byte {position} has type {kind} and {size} bytes, which cannot be"
            raise ValueError(message)
        if depth > 0 and first and len(tag) > 8:  # the flags of a matrix, whose lowest byte is its class
            numeric = struct.unpack(f"{order}I", tag[8:12])[0] & 0xFF in _NUMERIC_CLASSES
        if kind == _MATRIX and size:
            _check(file, start, start + size, order, depth + 1)
        position, first = stop, False
