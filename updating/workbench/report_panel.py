"""The panel of the report: choose sections, write the page, and the PDF, slides and moving pictures with it."""

from __future__ import annotations

from typing import Any

from updating.report.page import titles
from updating.workbench.diagnosis_panel import log
from updating.workbench.opened import Opened

TITLE, ICON = "Report", "mdi-file-document-outline"

_KINDS = {"pdf": "PDF", "pptx": "slides (PPTX)", "gif": "moving shapes (GIF)"}


def panel(server: Any, opened: Opened) -> None:
    """Set up the panel's state and what its controls call."""
    state = server.state
    state.update(
        {
            "with_kinds": [], "sections": [], "asked_sections": [], "report_text": "",
        }
    )  # fmt: skip

    @state.change("panel", "running")
    def enter(panel: str, **_: Any) -> None:
        if panel == TITLE:
            all_titles = list(titles(opened.results()))
            kept = [title for title in state.asked_sections if title in all_titles]
            state.sections, state.asked_sections = all_titles, kept or all_titles
            file = opened.folder / "report.html"
            state.report_text = (
                f"The report is in {file}; open that file in any browser."
                if file.exists()
                else f"The report will be in {file}."
            )

    @server.controller.set("report")
    def report() -> None:
        chosen, all_titles = state.asked_sections, state.sections
        only = (
            []
            if len(chosen) == len(all_titles)
            else [word for title in all_titles if title in chosen for word in ("--only", title)]
        )
        kinds = [f"--{kind}" for kind in _KINDS if kind in state.with_kinds]
        server.controller.run_command(["report", str(opened.folder), *kinds, *only])


def show(server: Any) -> None:
    """Put the panel into the page."""
    from trame.widgets import html, vuetify3

    vuetify3.VSelect(
        v_model=("asked_sections",), items=("sections",), label="Sections", multiple=True, chips=True,
        density="compact", hide_details=True, id="sections",
    )  # fmt: skip
    with html.Div(classes="d-flex flex-wrap ga-4"):
        for kind, name in _KINDS.items():
            vuetify3.VCheckbox(label=name, value=kind, v_model=("with_kinds",), hide_details=True, id=kind)
    vuetify3.VBtn(
        "Write the report", click=server.controller.report,
        disabled=("!!running || asked_sections.length === 0",), color="primary", id="write-report",
    )  # fmt: skip
    log(server.controller, "-report")
    html.P("{{ report_text }}", classes="text-body-2 mt-3", id="report-text")
