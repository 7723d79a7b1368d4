"""Files written whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ema.errors import MeasurementError


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Give the path of a file beside `path` to write to, and put it there when all went well.

    Raises
    ------
    MeasurementError
        It cannot be written, or the disk is full; what was there before is left as it was.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        message = f"cannot write {path}: {error.strerror}. Choose another folder, or make room."
        raise MeasurementError(message) from error
    finally:
        part.unlink(missing_ok=True)
