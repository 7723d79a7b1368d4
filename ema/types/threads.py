"""Numbers that do not depend on how many threads multiply matrices."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

import scipy.linalg  # noqa: F401  # with its own BLAS, whose threads can be limited once it is there
from threadpoolctl import threadpool_limits

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
