"""The panel of the diagnosis: run it and stop it, its answer, the error step by step, and the effect added."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Sequence
from typing import Any

from updating.report.answer import explanation_table, opening
from updating.report.change_part import mode_changes, mode_chart, step_chart, steps
from updating.report.part import unbroken
from updating.workbench.opened import Command, Opened, cells, empty, figure, plot, table

TITLE, ICON = "Diagnosis", "mdi-stethoscope"

CHANGES = {
    "ema": "Grey: what is shown is of the modes before this identification.",
    "fit": "Grey: what is shown is of the fit before this one.",
    "diagnose": "Grey: what is shown is of the results before this diagnosis.",
}
"""Commands that replace the results that are shown, and the note that the page shows meanwhile."""

_END = {0: "Done.", 130: "Stopped.", -signal.SIGTERM: "Stopped before it began."}
"""The note at the end of a command, by its exit code; a command that is stopped says itself what it keeps."""

_STALE = "{ stale: stale }"


def panel(server: Any, opened: Opened) -> None:
    """Set up the panel's state and what its controls call."""
    server.state.update(
        {
            "running": "", "said": [], "badge": "", "sentence": "", "sentences": [], "steps": empty(),
            "changes": empty(), "explanations": {"header": [], "rows": []}, "found": [], "has_steps": False,
            "has_changes": False, "stale": "", "remarks": [],
        }
    )  # fmt: skip
    commands = _Commands(server.state, opened)
    controller = server.controller
    controller.fit = commands.fit
    controller.diagnose = commands.diagnose
    controller.add_found = commands.add_found
    controller.run_command = commands.start
    controller.stop = commands.command.stop
    commands.refresh()


class _Commands:
    """The commands that the panel runs, and their results as state."""

    def __init__(self, state: Any, opened: Opened) -> None:
        self.state, self.opened, self.command = state, opened, Command(self._show_lines)

    def refresh(self) -> None:
        """Show what the folder holds now."""
        state, results = self.state, self.opened.results()
        first, diagnosis = opening(results), results.diagnosis
        state.badge, state.sentence = first.badge, unbroken(first.sentence)
        state.sentences = [] if diagnosis is None else [unbroken(text) for text in diagnosis.sentences]
        state.found = (
            []
            if diagnosis is None or not diagnosis.set
            else [e for e in diagnosis.set[0] if e not in diagnosis.measurement]
        )
        state.explanations = cells(explanation_table(results))
        way, modes = steps(results), mode_changes(results)
        state.has_steps, state.has_changes = bool(way), bool(modes)
        if way:
            state.steps = figure(step_chart(way))
        if modes:
            state.changes = figure(mode_chart(modes))
        state.remarks, state.stale = [unbroken(text) for text in results.remarks], ""

    def fit(self) -> None:
        """Fit G_f and d_f."""
        self._run("fit")

    def diagnose(self) -> None:
        """Run the diagnosis."""
        self._run("diagnose")

    def add_found(self) -> None:
        """Add the effects that were identified."""
        self._run("fit", *(word for name in self.state.found for word in ("--effect", name)))

    def _run(self, what: str, *further: str) -> None:
        self.start([what, str(self.opened.campaign), "-o", str(self.opened.folder), *further])

    def start(self, arguments: Sequence[str]) -> None:
        """Run `lamella` with these arguments."""
        self.state.running, self.state.said = arguments[0], []
        if arguments[0] in CHANGES:
            self.state.stale = CHANGES[arguments[0]]
        # a task: the page's next message, such as a stop, waits for what this call awaits
        self._task = asyncio.get_running_loop().create_task(self.command.run(arguments, self._done))

    async def _done(self, code: int) -> None:
        with self.state as state:
            state.running = ""
            state.said = [*state.said, _END.get(code, f"Ended with exit code {code}.")]
            self.refresh()
            state.dirty("configuration")  # the other panels read what is new

    def _show_lines(self, lines: list[str]) -> None:
        with self.state as state:
            state.said = lines


def show(server: Any) -> None:
    """Put the panel into the page."""
    from trame.widgets import html, vuetify3

    controller = server.controller
    with html.Div(classes="d-flex flex-wrap ga-2 align-center"):
        vuetify3.VBtn("Fit G_f and d_f", click=controller.fit, disabled=("!!running",), id="fit")
        vuetify3.VBtn("Diagnose", click=controller.diagnose, disabled=("!!running",), color="primary", id="diagnose")
        vuetify3.VBtn(
            "Add what was identified",
            click=controller.add_found,
            disabled=("!!running || found.length === 0",),
            id="add",
        )
    log(controller)
    html.P("{{ stale }}", v_if="stale", classes="text-body-2 mt-2", id="stale")
    html.P("{{ line }}", v_for="line in remarks", key="line", classes="text-body-2 mt-2 remark")
    with html.Div(classes=(_STALE,), id="answer"):
        _answer()


def _answer() -> None:
    """Show the answer: in a word, in a sentence, in pictures, in full and as a table."""
    from trame.widgets import html, vuetify3

    vuetify3.VChip("{{ badge }}", classes="mt-3", id="badge")
    html.P("{{ sentence }}", classes="text-h6 my-2", id="sentence")
    with vuetify3.VRow():
        with vuetify3.VCol(cols=12, md=5, v_show="has_steps"):
            plot("steps", 360)
        with vuetify3.VCol(cols=12, md=7, v_show="has_changes"):
            plot("changes", 360)
    html.P("{{ line }}", v_for="line in sentences", key="line", classes="text-body-2 my-1")
    table("explanations", "ranking")


def log(controller: Any, suffix: str = "") -> None:
    """Show the output of a command and the button that stops it; `suffix` is added to their names, one a panel."""
    from trame.widgets import html, vuetify3

    with html.Div(v_if="running", classes="d-flex align-center ga-3 mt-2"):
        vuetify3.VProgressCircular(indeterminate=True, size=22)
        html.Span("lamella {{ running }} is running")
        vuetify3.VBtn("Stop", click=controller.stop, color="error", size="small", id=f"stop{suffix}")
    html.Pre(
        "{{ said.slice(-12).join('\\n') }}", v_if="said.length", classes="text-caption pa-2 mt-2 bg-grey-lighten-4",
        style="overflow-x: auto; font-family: monospace !important", id=f"said{suffix}",
    )  # fmt: skip
