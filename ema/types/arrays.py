"""Large arrays, worked on some functions at a time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

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
