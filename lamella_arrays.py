"""Arrays as `ema`, `model` and `updating` share them: their types, and data types in which they are read-only."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from mmap import mmap
from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

T = TypeVar("T")

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


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
    array = np.array(value, dtype=dtype, copy=None if _is_frozen(value) else True)
    fits = array.ndim == len(shape) and all(e is None or e == n for e, n in zip(shape, array.shape, strict=True))
    if not fits:
        expected = "(" + ", ".join("any" if e is None else str(e) for e in shape) + ")"
        raise ValueError(f"{owner}.{name}: expected shape {expected}, got {array.shape}")
    array.flags.writeable = False
    return array


def frozen(value: NDArray[Any]) -> NDArray[Any]:
    """Return an array, with what it is a view of, that nobody writes any more, so that `readonly` does not copy it."""
    part: Any = value
    while isinstance(part, np.ndarray):
        part.flags.writeable = False
        part = part.base
    return value


def _is_frozen(value: object) -> bool:
    """Tell whether nobody writes an array: neither it nor what it is a view of, which may be a file, can be written."""
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
