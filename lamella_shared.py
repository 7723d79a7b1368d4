"""What `ema`, `model` and `updating` share, though the first two do not know each other.

Names that are imported when first used: a package that imports all of its modules takes seconds to start, also where
one of them is needed. Its stub, `__init__.pyi`, is what type checkers read; here it says at run time, too, which module
has which name.

Results that show themselves in a notebook as a table and as a figure: a type is defined before anything that draws it,
so a folder that draws registers how, and is imported when a result is first shown.

Data types whose arrays are read-only and of checked shapes.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import singledispatch
from html import escape
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import DTypeLike, NDArray

T = TypeVar("T")


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
    import numpy as np  # here: the packages are imported without it

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
    """Tell whether nobody writes an array: neither it nor what it is a view of can be written."""
    import numpy as np

    if not isinstance(value, np.ndarray) or value.flags.writeable:
        return False
    return value.base is None or _is_frozen(value.base)


_DTYPES = {"complex": complex, "int": int, "bool": bool}  # by the beginning of what NDArray is of; else float


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
            name: next((dtype for word, dtype in _DTYPES.items() if f"[np.{word}" in text), float)
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
