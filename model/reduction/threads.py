"""Large products of matrices on all processors, with the same numbers whatever their number."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def threaded(function: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
    """Yield a function of every item, in order, each computed by one of as many threads as there are processors.

    It pays for what spends its time in products of large matrices.
    """
    with ThreadPoolExecutor(n_processor()) as threads:
        yield from threads.map(function, items)


def n_processor() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
