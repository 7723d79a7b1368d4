"""What long work of several tasks is at: how many are done, for how long, and what the last message says."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

LOG = logging.getLogger("ema")
"""Where identification says what it does."""


EVERY = 30.0
"""Seconds between two lines where there is no terminal: nobody waits longer without a word, and short work has none."""
_LONGEST = 200  # characters of a message
_CONTROL = dict.fromkeys((*range(32), *range(127, 160)), " ")


class _Shown(logging.Handler):
    """Shows the last message behind what is being done as a whole, and of its details the last one behind both."""

    def __init__(self, text: str, bar: Progress) -> None:
        super().__init__(logging.DEBUG)
        self._text, self._bar, self._last = text, bar, text

    def emit(self, record: logging.LogRecord) -> None:
        """Show a message."""
        text = record.getMessage()
        if record.levelno >= logging.INFO:
            text = self._last = f"{self._text}: {text}"
        else:
            text = f"{self._last}: {text}"
        self._bar.update(self._bar.task_ids[0], description=text.translate(_CONTROL))


class _Written(logging.Handler):
    """Writes the last message as a line from time to time: a file or a pipe has no place where one replaces another."""

    def __init__(self, text: str, bar: Progress, console: Console) -> None:
        super().__init__(logging.DEBUG)
        self._text, self._bar, self._console = text, bar, console
        self._start = self._last = time.monotonic()

    def emit(self, record: logging.LogRecord) -> None:
        """Write a message if the last one is long past."""
        now = time.monotonic()
        if now - self._last < EVERY:
            return
        self._last = now
        task = self._bar.tasks[0]
        line = (
            f"{self._text}: {record.getMessage()} ({task.completed:.0f} of {task.total:.0f} done, "
            f"{now - self._start:.0f} s)"
        )
        self._console.print(line.translate(_CONTROL), markup=False, highlight=False, soft_wrap=True)


class _Sent(logging.Handler):
    """Sends messages to the process that shows them; pieces this short arrive whole whoever else writes."""

    def __init__(self, to: Connection) -> None:
        super().__init__(logging.DEBUG)
        self._to = to

    def emit(self, record: logging.LogRecord) -> None:
        """Send a message."""
        with suppress(OSError):  # nobody hears any more
            self._to.send((record.levelno, record.getMessage()[:_LONGEST]))


@contextmanager
def shown(text: str, n_task: int, console: Console) -> Iterator[Progress]:
    """Show while the context lasts how many tasks are done, and what is logged of them here or heard (`hear`).

    Parameters
    ----------
    text : str
        What is being done as a whole.
    n_task : int
        Number of tasks; `Progress.advance` of the only one says that one more is done.
    console : Console
        Where; on one that is no terminal the last message is written as a line every `EVERY` seconds.
    """
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    level = LOG.level
    with Progress(*columns, console=console, transient=True) as bar:
        bar.add_task(text, total=n_task)
        handler = _Shown(text, bar) if console.is_terminal else _Written(text, bar, console)
        LOG.addHandler(handler)
        LOG.setLevel(logging.DEBUG)
        try:
            yield bar
        finally:
            LOG.setLevel(level)
            LOG.removeHandler(handler)


def send(to: Connection) -> None:
    """Send what this process logs to the one that hears it, from now on."""
    LOG.addHandler(_Sent(to))
    LOG.setLevel(logging.DEBUG)


def hear(told: Connection) -> None:
    """Log what other processes send, until all of them have ended."""
    try:
        while True:
            level, text = told.recv()
            LOG.log(level, "%s", text)
    except (EOFError, OSError):
        return
