"""Files of text that describe a stack."""

from __future__ import annotations

import errno
from pathlib import Path


def plain_text(path: Path) -> str:
    """Return the text of a file, without the mark of its byte order that some editors set.

    Raises
    ------
    OSError
        It cannot be read, or is a pipe or a device, which would keep the reader waiting or never end.
    ValueError
        It is not text.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise OSError(errno.EINVAL, "is a pipe or a device; give a plain file", str(path))
    return path.read_text(encoding="utf-8-sig")
