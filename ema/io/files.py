"""Files read where they are plain ones, written whole or not at all, and files in TOML that have a form."""

from __future__ import annotations

import difflib
import errno
import json
import os
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError


def plain_bytes(path: Path) -> bytes:
    """Return the content of a file.

    Raises
    ------
    OSError
        It cannot be read, or is a pipe or a device, which would keep the reader waiting or never end.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise OSError(errno.EINVAL, "is a pipe or a device; give a plain file", str(path))
    return path.read_bytes()


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


Form = TypeVar("Form", bound=Section)


def read_form(path: Path, form: type[Form], error: type[Exception]) -> Form:
    """Read a TOML file and check its form.

    Parameters
    ----------
    path : Path
        The file.
    form : type of Section
        The form of the whole file.
    error : type of Exception
        What is raised when the file cannot be read, is not TOML, or has a key that is unknown, missing or
        impossible; its message names the file and every faulty key.
    """
    try:
        given = read_toml(path)
    except OSError as cause:
        files = sorted(path.glob("*.toml"))  # none where it is no folder
        fault = f"is a folder; give a file, such as {files[0]}" if files else cause.strerror
        message = f"{path}: cannot be read: {fault}"
        raise error(message) from cause
    except (ValueError, RecursionError) as cause:  # brackets by the thousand
        message = f"{path}: not valid TOML: {cause}"
        raise error(message) from cause
    if unfilled := list(_unfilled(given)):
        raise error("\n".join(f'{path}: {key}: is to be filled in, "?" stands there' for key in unfilled))
    try:
        return form.model_validate_json(json.dumps(given, default=str), strict=True)  # or true would be 1
    except ValidationError as cause:
        faults: list[dict[str, Any]] = [dict(fault) for fault in cause.errors()]
        places = [fault["loc"] for fault in faults]
        # pydantic also reports a list as too short when its entries have faults; the entries say it all
        deepest = [f for f in faults if all(p == f["loc"] or p[: len(f["loc"])] != f["loc"] for p in places)]
        raise error("\n".join(f"{path}: {_explained(fault, form)}" for fault in deepest)) from cause


def read_toml(path: Path) -> dict[str, Any]:
    """Return what a TOML file holds, with or without the mark of its byte order that some editors set.

    Raises
    ------
    OSError
        It cannot be read, or is no plain file.
    ValueError, RecursionError
        It is not TOML.
    """
    return tomllib.loads(plain_bytes(path).decode("utf-8-sig"))


def _unfilled(given: Any, key: str = "") -> Iterator[str]:
    """Give the keys whose value is "?", which `lamella new` writes for what nobody can guess."""
    if given == "?":
        yield key
    elif isinstance(given, dict):
        for name, value in given.items():
            yield from _unfilled(value, f"{key}.{name}".lstrip("."))
    elif isinstance(given, list):
        for number, value in enumerate(given, start=1):
            yield from _unfilled(value, f"{key}[{number}]")


def _explained(fault: dict[str, Any], form: type[BaseModel]) -> str:
    """Return one fault, of `ValidationError.errors`: the key, what is wrong, and what is allowed."""
    location = fault["loc"]
    key = "".join(f"[{p + 1}]" if isinstance(p, int) else f".{p}" for p in location).lstrip(".")
    if fault["type"] == "extra_forbidden":
        allowed = _keys_at(form, location[:-1])
        return f"{key}: unknown key; {did_you_mean(str(location[-1]), allowed)}"
    if fault["type"] == "missing":
        return f"{key}: this key is missing"
    text = str(fault["msg"]).removeprefix("Value error, ")
    return f"{key}: {text}, found {fault['input']!r}" if fault["type"] != "value_error" else f"{key}: {text}"


def _keys_at(form: type[BaseModel], location: tuple[str | int, ...]) -> list[str]:
    """Return the keys that a table at a place of a file can have."""
    for part in location:
        field = form.model_fields.get(str(part))
        if field is not None:  # else the place in a list, or a name that the user gives
            form = next(_forms_in(field.annotation), form)
    return list(form.model_fields)


def _forms_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _forms_in(part)


def did_you_mean(name: str, allowed: list[str]) -> str:
    """Return the names closest to a misspelt one, and all that are allowed."""
    close = difflib.get_close_matches(name, allowed, n=2)
    hint = f"did you mean {' or '.join(map(repr, close))}? " if close else ""
    return f"{hint}Allowed: {', '.join(allowed)}"
