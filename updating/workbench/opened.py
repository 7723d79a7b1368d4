"""What panels share: the results that are open, their page, and commands that run beside it."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ema.campaign.campaign import Campaign
from updating.errors import StoreError
from updating.fitting.plots import ShapePair
from updating.report.modes_part import gallery_of
from updating.report.page import render
from updating.report.part import Chart, Section
from updating.report.results import Results, Tested, read_results, with_models
from updating.results.identified import campaign_file
from updating.results.store import read_result
from updating.results.text import Table
from updating.workers.progress import CLOCK, PERIOD

_FILE = "campaign.toml"


@dataclass(frozen=True, kw_only=True)
class Opened:
    """A campaign file and the folder of its results."""

    campaign: Path
    folder: Path

    def results(self) -> Results:
        """Read what the folder holds now."""
        return read_results(self.folder)

    def stated(self) -> Campaign:
        """Read the campaign that is stored with the results."""
        return read_result(self.folder / "campaign.json", Campaign)

    def tested(self, name: str) -> Tested:
        """Read one configuration as it is now."""
        return next(tested for tested in self.results().tested if tested.name == name)

    def modelled(self, name: str) -> tuple[Tested, tuple[str, ...]]:
        """Return one configuration with its models, which are solved where they are not kept, and remarks on them."""
        results = self.results()
        found = with_models(replace(results, tested=tuple(t for t in results.tested if t.name == name)))
        return found.tested[0], found.remarks


def find(path: Path, output: Path | None, make: Callable[[Path, Path], object]) -> Opened:
    """Find the campaign and results that a path names: a results folder, a campaign file, or a folder with one.

    Parameters
    ----------
    path : Path
        What is to be opened.
    output : Path, optional
        Folder for the results of a campaign; by default `out` and the name of the campaign's folder.
    make : callable
        Makes the results of a campaign file in a folder where there are none.

    Raises
    ------
    StoreError
        There is nothing of this kind, or the campaign file of the results is not where it was.
    """
    if (path / "campaign.json").exists():
        return Opened(campaign=campaign_file(path), folder=path)
    file = path / _FILE if (path / _FILE).exists() else path
    if not file.is_file():
        raise StoreError(
            f"{path}: nothing to open; give a campaign file, a folder with a campaign.toml, or a folder of results "
            "with a campaign.json"
        )
    folder = output if output is not None else Path("out") / file.absolute().parent.name
    if not (folder / "campaign.json").exists():
        make(file, folder)
    return Opened(campaign=file, folder=folder)


CLICKED = "[$event.points[0].pointNumber, $event.points[0].curveNumber]"
"""What a click on a chart sends: the number of the point, of a matrix its row and column, and of the trace."""

_FONT = {"family": "Roboto, system-ui, sans-serif", "size": 12}


def figure(chart: Chart) -> dict[str, Any]:
    """Return a chart as a figure of the page."""
    drawn = chart.plain
    drawn["layout"] |= {"autosize": True, "font": _FONT}
    return drawn


def plot(
    key: str,
    height: int,
    click: Callable[..., Any] | None = None,
    sends: str = CLICKED,
    hover: Callable[..., Any] | None = None,
    *,
    solid: bool = False,
) -> Any:
    """Put a figure, the state `key`, into the page; a click calls `click` with what the expression `sends` gives.

    `hover` is called likewise with what is under the cursor. What is `solid` is seen from as far as its height asks, so
    on a narrow page it is less high, or its ends are cut.
    """
    from trame.widgets import html, plotly

    high = f"min({height}px, 60vw)" if solid else f"{height}px"
    with html.Div(style=f"height: {high}; width: 100%; min-width: 0", id=key) as box:
        calls = {"click": click, "hover": hover}
        others = {name: (call, sends) for name, call in calls.items() if call is not None}
        plotly.Figure(
            state_variable_name=key, display_logo=("false",), responsive=("true",), display_mode_bar=("'hover'",),
            style="height: 100%; width: 100%", **others,
        )  # fmt: skip
    return box


def empty() -> dict[str, Any]:
    """Return a figure without anything in it."""
    return {"data": [], "layout": {}}


def cells(table: Table) -> dict[str, Any]:
    """Return a table as the state that `table` shows."""
    return {"header": list(table.header), "rows": [list(row) for row in table.rows]}


def table(key: str, name: str) -> None:
    """Put a table, the state `key` as `cells` makes it, into the page, with a name for its element."""
    from trame.widgets import html, vuetify3

    with vuetify3.VTable(density="compact", v_if=f"{key}.rows.length", id=name):
        html.Thead(f"<tr><th v-for='h in {key}.header' :key='h'>{{{{ h }}}}</th></tr>")
        html.Tbody(
            f"<tr v-for='(row, i) in {key}.rows' :key='i'><td v-for='(c, k) in row' :key='k'>{{{{ c }}}}</td></tr>"
        )


_SHOWN = 400  # lines of what it says that are kept


_CODE = "from updating.commands.command_line import main; main()"


_PERIOD = "1"  # s between two lines of progress, of which the page shows the last


def followed(lines: Sequence[str], line: str) -> list[str]:
    """Return lines with a new one; of lines of progress, which only state the time and the step, keep the last one."""
    kept = lines[:-1] if lines and CLOCK.search(lines[-1]) and CLOCK.search(line) else lines
    return [*kept, line]


class Command:
    """One command of `lamella` at a time, in a process that the page can stop and does not wait for.

    Parameters
    ----------
    show_lines : callable
        Takes the lines that are printed so far, each time that there is a new one.
    """

    def __init__(self, show_lines: Callable[[list[str]], None]) -> None:
        self._show_lines = show_lines
        self._process: asyncio.subprocess.Process | None = None

    @property
    def running(self) -> bool:
        """Whether a command runs now."""
        return self._process is not None

    async def run(self, arguments: Sequence[str], ended: Callable[[int], Awaitable[None]]) -> None:
        """Run `lamella` with these arguments and call `ended` with its exit code."""
        last_words = 2.0  # s
        if self.running:
            return
        self._process = await asyncio.create_subprocess_exec(
            sys.executable, "-c", _CODE, *arguments,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            env={**os.environ, "COLUMNS": "100", PERIOD: _PERIOD},
            start_new_session=True,  # a group of its own, so that its workers are ended with it
        )  # fmt: skip
        reading = asyncio.create_task(self._read(self._process.stdout))
        try:
            code = await self._process.wait()
            with suppress(TimeoutError):  # a worker may hold its output a moment longer
                await asyncio.wait_for(reading, last_words)
        finally:
            self._process = None
        await ended(code)

    async def _read(self, output: asyncio.StreamReader | None) -> None:
        lines: list[str] = []
        if output is not None:
            async for line in output:
                lines = followed(lines, line.decode(errors="replace").rstrip())[-_SHOWN:]
                self._show_lines(lines)

    def stop(self) -> None:
        """End the command as Ctrl-C does; what is written is whole, and it goes on from there when it is run again.

        It ends its workers itself. Where it does not within some seconds, it and they are killed.
        """
        patience = 15.0  # s that a command has to end
        if self._process is None:
            return
        process = self._process
        with suppress(ProcessLookupError):
            process.terminate()
        with suppress(RuntimeError):  # no loop runs where the workbench itself ends
            asyncio.get_running_loop().call_later(patience, self._kill, process)

    def _kill(self, process: asyncio.subprocess.Process) -> None:
        if process.returncode is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL) if hasattr(os, "killpg") else process.kill()


def moving_page(pair: ShapePair, box: list[float] | None) -> str:
    """Return a page on which a pair of shapes moves."""
    return render("Shapes", (Section(title="Shapes", blocks=(gallery_of("pair", (pair,), box),)),), bare=True)


def moving_shapes(key: str, height: int) -> Callable[[dict[str, Any]], None]:
    """Put the page that is the state `key` into a frame; return what sends it another pair (`shape_numbers`)."""
    from trame.widgets import client, html

    html.Iframe(srcdoc=(key,), style=f"width: 100%; height: {height}px; border: 0", id=key, title="Shapes that move")
    return client.JSEval(exec=f"window.document.getElementById('{key}').contentWindow.postMessage($event, '*')").exec
