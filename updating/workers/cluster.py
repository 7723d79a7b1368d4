"""The connection to a Dask cluster; imported only where one is asked for, since Dask is an extra."""

from __future__ import annotations

from concurrent.futures import CancelledError
from typing import Any

import dask
from distributed import Client, KilledWorker, WorkerPlugin
from distributed.comm import CommClosedError

from ema.types.arrays import one_blas_thread

LOST = (KilledWorker, CancelledError, CommClosedError)
"""Errors of a task that the cluster could not finish."""
_ANSWER = "10 s"
_LARGEST = "4 GB"
"""What is sent with tasks before Dask warns: models of all specimens are some 80 MB, and all tasks need them."""


class _OneThread(WorkerPlugin):  # type: ignore[misc]  # Dask has no types
    """Gives every worker, also one that comes later, one BLAS thread."""

    name = "lamella"

    def setup(self, worker: Any) -> None:  # noqa: ARG002  # Dask gives it by name
        one_blas_thread()


def connect(address: str) -> Client:
    """Connect to the scheduler at an address.

    Raises
    ------
    OSError, ValueError
        None answers, or the address is none.
    """
    dask.config.set({"distributed.admin.large-graph-warning-threshold": _LARGEST})
    client = Client(address, timeout=_ANSWER, set_as_default=False)
    client.register_plugin(_OneThread())
    return client
