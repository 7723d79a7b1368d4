"""The terminal: what commands print on, and how they show what long work is at."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.status import Status

OUT = Console() if sys.stdout.isatty() else Console(width=100)  # a file or pipe has no width of its own


class _Shown(logging.Handler):
    """Shows the last message behind a title."""

    def __init__(self, title: str, status: Status) -> None:
        super().__init__(logging.INFO)
        self._title, self._status = title, status

    def emit(self, record: logging.LogRecord) -> None:
        """Show a message."""
        self._status.update(f"{self._title}: {record.getMessage()}")


@contextmanager
def progress(title: str, console: Console) -> Iterator[None]:
    """Show on a console, while the context lasts, what this package logs that it does.

    Parameters
    ----------
    title : str
        What is being done as a whole.
    console : Console
        Where; nothing is shown on one that is no terminal.
    """
    log = logging.getLogger("updating")
    level = log.level
    with console.status(title) as status:
        handler = _Shown(title, status)
        log.addHandler(handler)
        log.setLevel(logging.INFO)
        try:
            yield
        finally:
            log.setLevel(level)
            log.removeHandler(handler)


def bar(console: Console) -> Progress:
    """Return a bar that shows how many steps are done, and is gone at the end."""
    return Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        console=console, transient=True,
    )  # fmt: skip
