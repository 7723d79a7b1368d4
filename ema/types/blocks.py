"""Large functions worked on some at a time, where all at once would take several times their memory."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

BLOCK = 8
"""Outputs whose functions are worked on at a time."""
_LINES = 1024  # worked on at a time


def in_blocks(channels: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """Give channels, (n,), at most `BLOCK` at a time."""
    for start in range(0, channels.size, BLOCK):
        yield channels[start : start + BLOCK]


def inner_products(value: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the inner products, (n, n), of functions (n, n_frequency), without a copy of all of them."""
    total = np.zeros((len(value), len(value)), complex)
    for start in range(0, value.shape[1], _LINES):
        part = value[:, start : start + _LINES]
        total += part @ part.conj().T
    return total
