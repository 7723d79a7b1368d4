"""What `ema`, `model` and `updating` share, though the first two do not know each other.

Names that are imported when first used: a package that imports all of its modules takes seconds to start, also where
one of them is needed. Its stub, `__init__.pyi`, is what type checkers read; here it says at run time, too, which module
has which name.

Results that show themselves in a notebook as a table and as a figure: a type is defined before anything that draws it,
so a folder that draws registers how, and is imported when a result is first shown.

Plain files, and files in TOML that have a form.

Types of arrays, and data types in which they are read-only. A command that shows its help needs no NumPy, so this
module imports it when the first of these is asked for.
"""

from __future__ import annotations

import ast
import csv
import difflib
import errno
import io
import json
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import singledispatch
from html import escape
from importlib import import_module
from mmap import mmap
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_args

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import DTypeLike, NDArray
    from pydantic import BaseModel

    Reals = NDArray[np.float64]
    Complexes = NDArray[np.complex128]
    Integers = NDArray[np.int64]
    Booleans = NDArray[np.bool_]

T = TypeVar("T")
Form = TypeVar("Form", bound="BaseModel")


def exports(package: str, file: str) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__all__`, `__getattr__` and `__dir__` of a package whose stub lists what it has.

    Parameters
    ----------
    package : str
        Its `__name__`.
    file : str
        Its `__file__`; the stub lies beside it and holds lines `from module import name`.
    """
    stub = ast.parse(Path(file).with_name("__init__.pyi").read_text(encoding="utf-8"))
    home = {
        alias.name: node.module
        for node in stub.body
        if isinstance(node, ast.ImportFrom) and node.module is not None
        for alias in node.names
    }

    def __getattr__(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(home[name]), name)
        setattr(sys.modules[package], name, value)  # the next time it is there
        return value

    def __dir__() -> list[str]:
        return sorted({*vars(sys.modules[package]), *home})

    return sorted(home), __getattr__, __dir__


_DRAWERS: list[str] = []
"""Modules that are still to be imported before anything is shown."""


def drawn_by(module: str) -> None:
    """Name a module that registers how types show themselves; it is imported when a result is first shown."""
    _DRAWERS.append(module)


def _load_drawers() -> bool:
    """Import the modules that draw; tell whether there were any left to import."""
    waiting = bool(_DRAWERS)
    while _DRAWERS:
        import_module(_DRAWERS.pop())
    return waiting


@singledispatch
def html_of(result: object) -> str:
    """Return a result as HTML; each type registers how."""
    if _load_drawers():
        return html_of(result)
    return f"<pre>{escape(repr(result))}</pre>"


@singledispatch
def figure_of(result: object) -> Figure:
    """Return a result as a figure; each type registers how."""
    if _load_drawers():
        return figure_of(result)
    raise TypeError(f"nothing draws a {type(result).__name__}")


class Shown:
    """A result that shows itself: its table where a notebook ends with it, its figure where that is asked for."""

    def _repr_html_(self) -> str:
        return html_of(self)

    def plot(self) -> Figure:
        """Return the result as a matplotlib figure, tied to no window; save it with `savefig`."""
        return figure_of(self)


def html_table(title: str, header: Sequence[str], rows: Iterable[Sequence[str]], note: str = "") -> str:
    """Return text cells as an HTML table with a title above it and a note below."""

    def line(tag: str, cells: Sequence[str]) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    head = f"<thead>{line('th', header)}</thead>" if any(header) else ""
    body = "".join(line("td", row) for row in rows)
    below = f"<p>{escape(note)}</p>" if note else ""
    return f"<p><strong>{escape(title)}</strong></p><table>{head}<tbody>{body}</tbody></table>{below}"


def csv_text(header: Iterable[object], rows: Iterable[Iterable[object]]) -> str:
    """Return rows below a line of names as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()


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


def plain_text(path: Path) -> str:
    """Return the text of a file, without the mark of its byte order that some editors set; raises as `plain_bytes`."""
    return io.StringIO(plain_bytes(path).decode("utf-8-sig"), newline=None).getvalue()


def read_toml(path: Path) -> dict[str, Any]:
    """Return what a TOML file holds; raises `OSError`, or `ValueError` or `RecursionError` where it is not TOML."""
    return tomllib.loads(plain_text(path))


def toml_of(path: Path, error: type[Exception]) -> dict[str, Any]:
    """Return what a TOML file holds; `error` says why it cannot be read."""
    try:
        return read_toml(path)
    except OSError as cause:
        files = sorted(path.glob("*.toml"))  # none where it is no folder
        fault = f"is a folder; give a file, such as {files[0]}" if files else cause.strerror
        message = f"{path}: cannot be read: {fault}"
        raise error(message) from cause
    except (ValueError, RecursionError) as cause:  # brackets by the thousand
        message = f"{path}: not a TOML file: {cause}"
        raise error(message) from cause


def form_of(path: Path, given: dict[str, Any], form: type[Form], error: type[Exception]) -> Form:
    """Return the form that a file holds, strictly: true is not 1 and no text is a number.

    Parameters
    ----------
    path : Path
        The file.
    given : dict
        What is in it.
    form : type of pydantic.BaseModel
        The form of the whole file.
    error : type of Exception
        What is raised where a key is unknown, missing or impossible; its message names the file and every such key.
    """
    from pydantic import ValidationError

    if unfilled := list(_unfilled(given)):
        raise error("\n".join(f'{path}: {key}: is to be filled in, "?" stands there' for key in unfilled))
    try:
        return form.model_validate_json(json.dumps(given, default=str), strict=True)
    except ValidationError as cause:
        faults: list[dict[str, Any]] = [dict(fault) for fault in cause.errors()]
        locations = [fault["loc"] for fault in faults]
        # pydantic also reports a list as too short when its entries have faults; the entries say it all
        deepest = [f for f in faults if all(p == f["loc"] or p[: len(f["loc"])] != f["loc"] for p in locations)]
        raise error("\n".join(f"{path}: {_explained(fault, form)}" for fault in deepest)) from cause


def read_form(path: Path, form: type[Form], error: type[Exception]) -> Form:
    """Read a TOML file and check its form; `error` says what is wrong with it."""
    return form_of(path, toml_of(path, error), form, error)


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
    """Return the keys that a table in a file can have."""
    for part in location:
        field = form.model_fields.get(str(part))
        if field is not None:  # else the number in a list, or a name that the user gives
            form = next(_forms_in(field.annotation), form)
    return list(form.model_fields)


def _forms_in(annotation: Any) -> Iterator[type[BaseModel]]:
    from pydantic import BaseModel

    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _forms_in(part)


def did_you_mean(name: str, allowed: list[str]) -> str:
    """Return the names closest to a misspelt one, and all that are allowed."""
    close = difflib.get_close_matches(name, allowed, n=2)
    hint = f"did you mean {' or '.join(map(repr, close))}? " if close else ""
    return f"{hint}Allowed: {', '.join(allowed)}"


_ELEMENTS = {"Reals": "float64", "Complexes": "complex128", "Integers": "int64", "Booleans": "bool_"}


def __getattr__(name: str) -> Any:
    """Return the type of arrays that is called so."""
    if name not in _ELEMENTS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import numpy as np
    from numpy.typing import NDArray

    return NDArray[getattr(np, _ELEMENTS[name])]  # type: ignore[misc]  # which one is known at run time


def readonly(
    owner: str, name: str, value: object, shape: tuple[int | None, ...], dtype: DTypeLike = float
) -> NDArray[Any]:
    """Return `value` as a read-only array of `dtype` after checking its shape.

    Parameters
    ----------
    owner, name : str
        The data type and field that the array is for, named in the message of a failed check.
    value : array_like
        What was given; an array that can still be written is copied, so that it stays the caller's.
    shape : tuple of int or None
        Expected length of each axis; `None` accepts any length.
    dtype : dtype, default float
        Type to convert to.

    Raises
    ------
    ValueError
        The shape differs from the expected one; the message names both.
    """
    import numpy as np

    array = np.array(value, dtype=dtype, copy=None if _is_frozen(value) else True)
    fits = array.ndim == len(shape) and all(e is None or e == n for e, n in zip(shape, array.shape, strict=True))
    if not fits:
        expected = "(" + ", ".join("any" if e is None else str(e) for e in shape) + ")"
        raise ValueError(f"{owner}.{name}: expected shape {expected}, got {array.shape}")
    array.flags.writeable = False
    return array


def frozen(value: NDArray[Any]) -> NDArray[Any]:
    """Return an array, with what it is a view of, that nobody writes any more, so that `readonly` does not copy it."""
    import numpy as np

    part: Any = value
    while isinstance(part, np.ndarray):
        part.flags.writeable = False
        part = part.base
    return value


def _is_frozen(value: object) -> bool:
    """Tell whether nobody writes an array: neither it nor what it is a view of, which may be a file, can be written."""
    import numpy as np

    if not isinstance(value, np.ndarray) or value.flags.writeable:
        return False
    return value.base is None or isinstance(value.base, mmap) or _is_frozen(value.base)


_DTYPES = {"complex": complex, "int": int, "bool": bool}  # by a word of the annotation; else float


def arrays(shapes: Mapping[str, str]) -> Callable[[type[T]], type[T]]:
    """Make fields of a frozen data class read-only arrays of checked shapes, of the type that they are annotated with.

    It stands below `@dataclass`. What the class checks itself in `__post_init__` comes after it.

    Parameters
    ----------
    shapes : mapping of str to str
        Fields, with blanks between them, by the lengths of their axes, likewise. A length is a number; "any"; the name
        of a field, with dots of one of its fields, for the length of that; or another word, for the same length
        wherever it stands. A field that may be None is left as it is where it is None.

    Examples
    --------
    >>> @dataclass(frozen=True)
    ... @arrays({"any": "node", "node 3": "direction", "node mode": "shape", "mode": "frequency damping"})
    ... class Shapes: ...
    """
    axes = {name: tuple(shape.split()) for shape, names in shapes.items() for name in names.split()}

    def decorate(kind: type[T]) -> type[T]:
        stated: Callable[[T], None] | None = kind.__dict__.get("__post_init__")
        annotations = {name: str(kind.__annotations__[name]) for name in axes}
        optional = {name for name, text in annotations.items() if "None" in text}
        dtypes = {
            name: next((dtype for word, dtype in _DTYPES.items() if word in text.lower()), float)
            for name, text in annotations.items()
        }

        def __post_init__(self: T) -> None:
            lengths: dict[str, int | None] = {"any": None}
            for name, words in axes.items():
                value = getattr(self, name)
                if value is None and name in optional:
                    continue
                expected = tuple(_length(self, word, lengths) for word in words)
                array = readonly(type(self).__name__, name, value, expected, dtypes[name])
                lengths = {**dict(zip(words, array.shape, strict=True)), **lengths}
                object.__setattr__(self, name, array)
            if stated is not None:
                stated(self)

        kind.__post_init__ = __post_init__  # type: ignore[attr-defined]
        return kind

    return decorate


def _length(owner: object, word: str, lengths: dict[str, int | None]) -> int | None:
    """Return the length that a word stands for, None where it is not known yet."""
    if word in lengths:
        return lengths[word]
    if word.isdecimal():
        return int(word)
    value: Any = owner
    for part in word.split("."):
        if not hasattr(value, part):
            return None
        value = getattr(value, part)
    return len(value)
