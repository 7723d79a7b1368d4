"""Files written whole or not at all, and the form of files in TOML."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pydantic import BaseModel, ConfigDict


@contextmanager
def whole(path: Path, error: type[Exception]) -> Iterator[Path]:
    """Give a new file beside `path` to write to, and put it there when all went well; make its folder if need be.

    Parameters
    ----------
    path : Path
        The file to write. Whatever goes wrong, what was there before is left as it was.
    error : type of Exception
        What is raised when it cannot be written or the disk is full.
    """
    part = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        os.close(handle)
        part = Path(name)
        yield part
        part.chmod(0o644)
        part.replace(path)
    except OSError as cause:
        message = f"cannot write {path}: {cause.strerror}. Choose another folder with -o, or make room."
        raise error(message) from cause
    finally:  # whatever stopped it, Ctrl-C too
        if part is not None:
            part.unlink(missing_ok=True)


class Section(BaseModel):
    """Any table of such a file: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)
