"""Arrays: read-only and of a checked shape, and large ones worked on some functions at a time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray


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
    fits = array.ndim == len(shape) and all(
        e is None or e == n for e, n in zip(shape, array.shape, strict=True)
    )
    if not fits:
        expected = "(" + ", ".join("any" if e is None else str(e) for e in shape) + ")"
        message = f"{owner}.{name}: expected shape {expected}, got {array.shape}"
        raise ValueError(message)
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
    """Tell whether nobody writes an array: neither it nor what it is a view of can be written."""
    if not isinstance(value, np.ndarray) or value.flags.writeable:
        return False
    return value.base is None or _is_frozen(value.base)


BLOCK = 8
"""Outputs whose functions are worked on at a time."""


def in_blocks(channels: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """Give channels, (n,), at most `BLOCK` at a time."""
    for start in range(0, channels.size, BLOCK):
        yield channels[start : start + BLOCK]


def inner_products(
    value: NDArray[np.complex128], rows: NDArray[np.int64] | None = None, *, lines: int = 1024
) -> NDArray[np.complex128]:
    """Return the inner products, (n, n), of functions (n_all, n_frequency), without a copy of all of them.

    `rows`: of which functions, all where not given. `lines`: worked on at a time.
    """
    n = len(value) if rows is None else rows.size
    total = np.zeros((n, n), complex)
    for start in range(0, value.shape[1], lines):
        part = value[slice(None) if rows is None else rows, start : start + lines]
        total += part @ part.conj().T
    return total
