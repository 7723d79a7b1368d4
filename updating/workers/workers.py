"""Where tasks that do not need each other run: on the processors of this machine, or on a Dask cluster."""

from __future__ import annotations

import os
import pickle
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import Any, TypeVar
from uuid import uuid4

import cloudpickle
from rich.console import Console

from ema.types.arrays import one_blas_thread, single_threaded
from model.reduction.threads import n_processor
from updating.errors import WorkerError
from updating.workers.progress import hear, send, shown

T = TypeVar("T")
R = TypeVar("R")
_OWN = ("ema", "model", "updating")  # packages, which take long to import
_MESSAGES = 32  # in which the items of `distribute` are sent at most


def workers(n_task: int, cluster: str | None = None) -> AbstractContextManager[Executor]:
    """Offer an executor for tasks that do not need each other.

    Every task runs with one BLAS thread, so that its result does not depend on where it ran. `Executor.map` hands
    results on in the order of the tasks. Whatever ends the context early, such as Ctrl-C, ends the local workers too.

    Parameters
    ----------
    n_task : int
        Number of tasks. Locally there are as many processes as processors, but no more than tasks; a single one
        runs in this process.
    cluster : str, optional
        Address of a Dask scheduler, such as "tcp://10.0.0.1:8786", whose workers run the tasks. They must have this
        version of Lamella and see the files under the same absolute paths. Tasks of a worker that dies are run by
        another one.

    Raises
    ------
    WorkerError
        A local worker was killed, the cluster does not answer or lost a task several times, or Dask is not installed.
    """
    if cluster is not None:
        return _on_cluster(cluster)
    n_process = min(n_task, n_processor())
    return nullcontext(_ThisProcess()) if n_process < 2 else _pool(n_process)


def in_parallel(
    task: Callable[[T], R], items: Sequence[T], text: str, console: Console, cluster: str | None = None
) -> Iterator[R]:
    """Do a task with every item on `workers`, hand on the results in order, and show how many are done.

    What identification says of each is shown beside it, but from a cluster.

    Parameters
    ----------
    task : callable
        Of one item; a function of a module, or a partial one, that another process can import.
    items : sequence
        What to do it with.
    text : str
        What is being done.
    console : Console
        Where progress is shown.
    cluster : str, optional
        As in `workers`.

    Raises
    ------
    WorkerError
        See `workers`.
    """
    with workers(len(items), cluster) as executor, shown(text, len(items), console) as bar:
        for result in executor.map(task, items):
            bar.advance(bar.task_ids[0])
            yield result


def distribute(
    task: Callable[[T], R], items: Iterable[T], executor: Executor | None, messages: int = _MESSAGES
) -> Iterator[R]:
    """Do a task with every item, here or on an executor, and return the results in order.

    Parameters
    ----------
    task : callable
        Of one item. It is sent once for several items. It may hold, and return, whatever another process cannot
        import, such as models with their effects. Processes of this machine find it in a file.
    items : iterable
        What to do it with.
    executor : Executor or None
        Where; None is in this process.
    messages : int
        In how many the items are sent at most; on a cluster each holds the task, so fewer are better for a large one.
    """
    if executor is None:
        return map(task, items)
    listed = list(items)
    n = min(messages, len(listed))
    parts = [listed[i::n] for i in range(n)]  # neighbours, often alike in cost, go to different processes
    sent = executor.leave(task) if isinstance(executor, _Processes) else _Sent(cloudpickle.dumps(task))
    return _in_order(executor.map(sent, parts), len(listed), sent.arrays)  # begins at once


def _in_order(parts: Iterable[bytes], n_item: int, left: _Left | None) -> Iterator[Any]:
    """Yield the results in the order of the items, of which each part has every n-th, once they are asked for."""
    found = [cloudpickle.loads(part) for part in parts]
    if left is not None:
        left.path.unlink()
    yield from (found[i % len(found)][i // len(found)] for i in range(n_item))


@dataclass(frozen=True)
class _Left:
    """A file of numbers alone, and how many bytes of it each array has."""

    path: Path
    sizes: tuple[int, ...]


@dataclass(frozen=True)
class _Sent:
    """A task as bytes, its arrays in a file or among them, which a process reads once; it returns results as bytes.

    What runs comes from the process that asks, by its pipe, and never from a file.
    """

    content: bytes = field(repr=False)  # Dask writes what it is to do into its names
    arrays: _Left | None = None

    def __call__(self, items: list[Any]) -> bytes:
        if self not in _LAST:
            _LAST.clear()  # before the next one is read, for each holds a model
            _LAST[self] = self._read()
        return cloudpickle.dumps(list(map(_LAST[self], items)))

    def _read(self) -> Callable[[Any], Any]:
        if self.arrays is None:
            return cloudpickle.loads(self.content)
        arrays = [bytearray(size) for size in self.arrays.sizes]
        with self.arrays.path.open("rb") as file:
            for array in arrays:
                file.readinto(array)
        return pickle.loads(self.content, buffers=arrays)


_LAST: dict[_Sent, Callable[[Any], Any]] = {}
"""The task that this process had last."""


class _ThisProcess(Executor):
    """Runs each task when its result is asked for."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(single_threaded(fn)(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future

    def map(self, fn: Callable[..., Any], *iterables: Iterable[Any], **_: Any) -> Iterator[Any]:
        return (self.submit(fn, *item).result() for item in zip(*iterables, strict=False))


class _Processes(ProcessPoolExecutor):
    """Processes of this machine, with a folder in which arrays are left for them: a pipe is slow for large ones."""

    def __init__(self, n_process: int, context: BaseContext, ended: Connection, tell: Connection) -> None:
        super().__init__(n_process, context, initializer=_begin, initargs=(ended, tell))
        self.folder = TemporaryDirectory(prefix="lamella-", ignore_cleanup_errors=True)

    def leave(self, task: Callable[..., Any]) -> _Sent:
        """Return a task for the processes, its arrays as they are in a file."""
        path, arrays = Path(self.folder.name) / uuid4().hex, list[pickle.PickleBuffer]()
        content = cloudpickle.dumps(task, protocol=5, buffer_callback=arrays.append)
        with path.open("wb") as file:
            file.writelines(array.raw() for array in arrays)
        return _Sent(content, _Left(path, tuple(array.raw().nbytes for array in arrays)))

    def close_results(self) -> None:
        """Close this process's own end for writing results.

        Results are read until all such ends are closed. Of a worker that ends amidst a large result half of it is
        in the pipe, and the executor would wait for the other half forever.
        """
        if self._result_queue is not None:  # as it is after an end in good order
            self._result_queue._writer.close()  # type: ignore[attr-defined]  # there is no public way


@contextmanager
def _pool(n_process: int) -> Iterator[Executor]:
    context = _context()
    ended, end = context.Pipe(duplex=False)
    messages, tell = context.Pipe(duplex=False)
    executor = _Processes(n_process, context, ended, tell)
    Thread(target=hear, args=(messages,), daemon=True).start()
    starting = Thread(target=executor.submit, args=(os.getpid,))
    starting.start()  # of all processes, now, beside what is done before they are needed: they import long
    try:
        yield executor
        starting.join()
        executor.shutdown()
    except BrokenProcessPool as error:
        raise WorkerError(
            "a worker process was killed, perhaps for want of memory; what was done is kept, "
            "and the same command goes on from there"
        ) from error
    finally:
        starting.join()
        end.close()
        executor.close_results()
        executor.shutdown(cancel_futures=True)
        executor.folder.cleanup()
        ended.close()
        tell.close()


def _context() -> BaseContext:
    """Return how processes start: on Linux as copies of one that has imported, once for all, what this one has.

    Elsewhere each imports for itself, as copies are not safe beside the system's libraries.
    """
    if sys.platform != "linux":
        return get_context("spawn")
    context = get_context("forkserver")
    context.set_forkserver_preload([name for name in sys.modules if name.partition(".")[0] in _OWN])
    return context


def _begin(ended: Connection, tell: Connection) -> None:
    """Set up a worker process, which ends with the other end of a pipe: when that is closed or its owner killed."""
    send(tell)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the owner's
    one_blas_thread()
    Thread(target=_end_with, args=(ended,), daemon=True).start()


def _end_with(ended: Connection) -> None:
    try:
        ended.recv()
    except (EOFError, OSError):
        os._exit(1)


@contextmanager
def _on_cluster(address: str) -> Iterator[Executor]:
    try:
        from updating.workers.cluster import LOST, connect  # here: few have Dask
    except ImportError as error:
        raise WorkerError(
            f'--cluster needs Dask, which is not installed ({error}): pip install "lamella[cluster]"'
        ) from error
    try:
        client = connect(address)
    except (OSError, ValueError) as error:
        raise WorkerError(f"no Dask scheduler answers at {address}: {error}") from error
    with client:
        try:
            yield client.get_executor(pure=False)
        except LOST as error:
            raise WorkerError(
                f"the cluster at {address} lost a task: {error}. What was done is kept, "
                "and the same command goes on from there"
            ) from error
