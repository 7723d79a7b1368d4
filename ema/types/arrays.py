"""Large arrays, worked on some functions at a time, and numbers that depend on no number of threads."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import wraps
from typing import ParamSpec, TypeVar

import numpy as np
import scipy.linalg  # noqa: F401  # with its own BLAS, whose threads can be limited once it is there
from threadpoolctl import threadpool_limits

from lamella_shared import Complexes, Integers

BLOCK = 8
"""Outputs whose functions are worked on at a time."""


def in_blocks(channels: Integers) -> Iterator[Integers]:
    """Give channels, (n,), at most `BLOCK` at a time."""
    for start in range(0, channels.size, BLOCK):
        yield channels[start : start + BLOCK]


def inner_products(value: Complexes, rows: Integers | None = None, *, lines: int = 1024) -> Complexes:
    """Return the inner products, (n, n), of functions (n_all, n_frequency), without a copy of all of them.

    `rows`: of which functions, all where not given. `lines`: worked on at a time.
    """
    n = len(value) if rows is None else rows.size
    total = np.zeros((n, n), complex)
    for start in range(0, value.shape[1], lines):
        part = value[slice(None) if rows is None else rows, start : start + lines]
        total += part @ part.conj().T
    return total


P = ParamSpec("P")
R = TypeVar("R")


def single_threaded(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function multiply matrices with one thread, whatever is set outside.

    Several threads add in another order, and what rests on small differences, such as the scatter that a fitted model
    leaves, shows it; the dense blocks here are too small to gain by more.
    """

    @wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        with threadpool_limits(1, user_api="blas"):
            return function(*args, **kwargs)

    return run


def one_blas_thread() -> None:
    """Let this process multiply matrices with one thread from now on."""
    threadpool_limits(1, user_api="blas")
