"""The room of the report: write the page, and the PDF with it."""

from __future__ import annotations

from typing import Any

from updating.workbench.diagnosis_room import log
from updating.workbench.opened import Opened

TITLE, ICON = "Report", "mdi-file-document-outline"


def room(server: Any, opened: Opened) -> None:
    """Keep the room's state right."""
    server.state.update({"with_pdf": False, "report_file": str(opened.folder / "report.html")})


def show(server: Any) -> None:
    """Put the room into the page."""
    from trame.widgets import html, vuetify3

    vuetify3.VCheckbox(label="Print a PDF too", v_model=("with_pdf",), hide_details=True, id="pdf")
    vuetify3.VBtn(
        "Write the report", click=(server.controller.report, "[with_pdf]"), disabled=("!!running",), color="primary",
        id="write-report",
    )  # fmt: skip
    log(server.controller)
    html.P("It is written to {{ report_file }}; open that file in any browser.", classes="text-body-2 mt-3")
