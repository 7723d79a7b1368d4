"""The terminal: what commands print on, and how they show what long work is at."""

from __future__ import annotations

import io
import logging
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.measure import Measurement
from rich.status import Status
from rich.table import Table as Printed
from rich.text import Text

if TYPE_CHECKING:
    from rich.progress import Progress

MOST_EXPLANATIONS = 8  # that a table prints
_CONTROL = {code: f"\\x{code:02x}" for code in (*range(32), *range(127, 160)) if chr(code) not in "\n\t"}


class LiteralConsole(Console):
    r"""Prints every string as it stands: brackets are no markup, and control characters become such as ``\x1b``.

    Names and paths are the user's, and may hold either.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **options)

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as any console does, but into a file or pipe no table narrower than its words: cells would be empty."""
        page, objects = self.width, tuple(one.__rich__() if hasattr(one, "__rich__") else one for one in objects)
        if not self.is_terminal:
            self.width = max([page, *(self._needed(table) for table in objects if isinstance(table, Printed))])
        super().print(*objects, **options)
        self.width = page

    def _needed(self, table: Printed) -> int:
        """Return the width of a table in which no word of it is cut."""
        widest = 10_000  # characters of a table in a file
        wide, width = self.options.update(width=widest), 1
        for column in table.columns:
            cells = [Measurement.get(self, wide, cell) for cell in (column.header, *column.cells)]
            words = max(cell.maximum if column.no_wrap else cell.minimum for cell in cells)
            width += max(words, column.min_width or 0, column.width or 0) + 3  # its frame
        return width

    def render_str(self, text: str, **options: Any) -> Text:
        """Return a string as what is printed of it, in tables too."""
        return super().render_str(literal(text), **options)


def literal(text: str) -> str:
    """Return a text without control characters, which would move the cursor or colour what follows."""
    return text.translate(_CONTROL)


OUT = LiteralConsole() if sys.stdout.isatty() else LiteralConsole(width=100)  # a pipe has no width of its own
ERR = LiteralConsole(stderr=True)


def print_lines(console: Console, lines: Iterable[str], indent: str = "  ", **options: Any) -> None:
    """Print lines, each behind an indent."""
    for line in lines:
        console.print(f"{indent}{line}", markup=False, highlight=False, **options)


def print_results(console: Console, output: Path) -> None:
    """Say where results are, and what makes a page of them."""
    console.print(f"Results in {output}; make a page of them: lamella report {output}")


def print_what_can_be() -> None:
    """Let stdout and stderr print signs that their encoding lacks as escapes, in place of a UnicodeEncodeError."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


class _Shown(logging.Handler):
    """Shows the last message behind a title."""

    def __init__(self, title: str, status: Status) -> None:
        super().__init__(logging.INFO)
        self._title, self._status, self.last, self._stage = title, status, title, 0

    def emit(self, record: logging.LogRecord) -> None:
        """Show a message, which begins a stage of the work."""
        self._stage += 1
        self.last = f"{self._title}, stage {self._stage}: {record.getMessage()}"
        self._status.update(Text(literal(self.last)))


@contextmanager
def progress(title: str, console: Console) -> Iterator[None]:
    """Show on a console, while the context lasts, what this package logs that it does.

    Parameters
    ----------
    title : str
        What is being done as a whole.
    console : Console
        Where; beside one that is no terminal, stderr has a line every few seconds.
    """
    from updating.workers.progress import in_lines

    logs = [logging.getLogger(name) for name in ("updating", "model")]
    levels = [log.level for log in logs]
    with console.status(title) as status:
        handler = _Shown(title, status)
        for log in logs:
            log.addHandler(handler)
            log.setLevel(logging.INFO)
        try:
            with in_lines(lambda: handler.last, console):
                yield
        finally:
            for log, level in zip(logs, levels, strict=True):
                log.setLevel(level)
                log.removeHandler(handler)


def bar(console: Console) -> Progress:
    """Return a bar that shows how many steps are done, and is gone at the end."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    return Progress(
        TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        console=console, transient=True,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Run:
    """What a command is asked to work on, and how.

    Attributes
    ----------
    campaign : Path
        Campaign file; of `lamella update` the updating file, which names these.
    output : Path
        Folder of the results.
    effect_files : tuple of Path
        Files of effects that the catalogue lacks.
    scatter_file : Path, optional
        What a laboratory states of its scatter.
    cluster : str, optional
        Address of a Dask scheduler; by default the processors of this machine work.
    keep : bool
        Whether results that an earlier run left are used whatever they come from.
    identify_anew : bool
        Whether poles that were chosen by hand are forgotten.
    console : Console
        Where progress is shown.
    """

    campaign: Path
    output: Path
    effect_files: tuple[Path, ...] = ()
    scatter_file: Path | None = None
    cluster: str | None = None
    keep: bool = False
    identify_anew: bool = False
    console: Console = OUT

    @property
    def stated(self) -> tuple[Path, ...]:
        """Files beside the campaign's that an answer depends on."""
        return self.effect_files if self.scatter_file is None else (*self.effect_files, self.scatter_file)
