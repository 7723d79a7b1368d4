"""What long work of several tasks is at: how many are done, for how long, and what the last message says."""

from __future__ import annotations

import logging
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from threading import Event, Thread
from time import monotonic

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

LOG = logging.getLogger("ema")
"""Where identification says what it does."""


PERIOD = "LAMELLA_PROGRESS_SECONDS"
"""Variable of the environment: time between two lines where there is no terminal, s."""
CLOCK = re.compile(r" \(\d+ s\)$")
"""How a line of progress ends."""
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


@contextmanager
def in_lines(now: Callable[[], str], console: Console) -> Iterator[None]:
    """Say on stderr every few seconds what work is at, where the console is no terminal, such as a pipe or a file.

    Parameters
    ----------
    now : callable
        Returns what it is at.
    console : Console
        Nothing is said beside one that shows it by itself, or that is quiet.
    """
    period_s = 3.0  # s, where it is not set, or not to 0.1 to 3600
    if console.is_terminal or console.quiet:
        yield
        return
    began, ended, period = monotonic(), Event(), period_s
    with suppress(ValueError):  # work is not refused for a slip in how often it is reported
        given = float(os.environ.get(PERIOD, ""))
        period = given if 0.1 <= given <= 3600.0 else period_s

    def say() -> None:
        while not ended.wait(period):
            print(f"{now().translate(_CONTROL)} ({monotonic() - began:.0f} s)", file=sys.stderr, flush=True)

    saying = Thread(target=say, daemon=True)
    saying.start()
    try:
        yield
    finally:
        ended.set()
        saying.join()


class _Sent(logging.Handler):
    """Sends messages to the process that shows them; pieces this short arrive whole whoever else writes."""

    def __init__(self, to: Connection) -> None:
        super().__init__(logging.DEBUG)
        self._to = to

    def emit(self, record: logging.LogRecord) -> None:
        """Send a message."""
        longest = 200  # characters of a message
        with suppress(OSError):  # nobody hears any more
            self._to.send((record.levelno, record.getMessage()[:longest]))


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
        Where; beside one that is no terminal, stderr has a line every few seconds.
    """
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    level = LOG.level
    with Progress(*columns, console=console, transient=True) as bar:
        bar.add_task(text, total=n_task)
        handler = _Shown(text, bar)
        LOG.addHandler(handler)
        LOG.setLevel(logging.DEBUG)

        def now() -> str:
            task = bar.tasks[0]
            return f"{task.description}, {task.completed:.0f} of {n_task} done"

        try:
            with in_lines(now, console):
                yield bar
        finally:
            LOG.setLevel(level)
            LOG.removeHandler(handler)


def send(to: Connection) -> None:
    """Send what this process logs to the one that hears it, from now on."""
    LOG.addHandler(_Sent(to))
    LOG.setLevel(logging.DEBUG)


def hear(messages: Connection) -> None:
    """Log what other processes send, until all of them have ended."""
    try:
        while True:
            level, text = messages.recv()
            LOG.log(level, "%s", text)
    except (EOFError, OSError):
        return
