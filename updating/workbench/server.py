"""The workbench's server: one page with a room for each job, on this machine alone."""

from __future__ import annotations

import os
import webbrowser
from collections.abc import Callable
from importlib.resources import files
from typing import Any

from updating.errors import StoreError
from updating.workbench import (
    comparison_room,
    diagnosis_room,
    identification_room,
    measurement_room,
    report_room,
    what_if_room,
)
from updating.workbench.access import HOST, address, guard, new_token
from updating.workbench.opened import Opened

ROOMS = (measurement_room, identification_room, comparison_room, what_if_room, diagnosis_room, report_room)

_STYLE = """
.v-field-label { opacity: 1 !important; color: #42526b; }
.stale { opacity: 0.45; filter: grayscale(1); }
"""
"""Labels that are not grey on grey, and what is shown of results that others are about to replace."""


def serve(opened: Opened, *, port: int, ready: Callable[[str], None], show: bool) -> None:
    """Serve the workbench until it is interrupted.

    Parameters
    ----------
    opened : Opened
        What to show.
    port : int
        Where to listen; 0 for any that is free.
    ready : callable
        Takes the address, with its token, once it answers.
    show : bool
        Whether to open it in the browser.

    Raises
    ------
    StoreError
        Nothing was identified.
    """
    server = page(opened)
    token = new_token()

    @server.controller.add("on_server_bind")
    def protect(web: Any) -> None:
        web.app.middlewares.append(guard(token, lambda: server.port, count))

    def count(tabs: int) -> None:
        with server.state as state:
            state.tabs = tabs

    @server.controller.add("on_server_ready")
    def tell(**_: Any) -> None:
        place = address(token, server.port)
        ready(place)
        if show:
            webbrowser.open(place)

    server.cli.set_defaults(authKey=token)
    os.environ.setdefault("TRAME_ARGS", "--server")  # or it would read the words of this command
    os.environ.setdefault("WSLINK_READY_MSG", "")
    try:
        server.start(port=port, host=HOST, open_browser=False, show_connection_info=False, timeout=0)
    finally:
        server.controller.stop()  # what still runs beside it


def page(opened: Opened) -> Any:
    """Build the page with all rooms."""
    from trame.app import get_server
    from trame.ui.vuetify3 import SinglePageLayout
    from trame.widgets import client, vuetify3

    results = opened.results()
    names = [own.name for own in results.tested]
    if not names:
        message = (
            f"{opened.folder}: a table of modes has no functions or shapes to open; make its page with: lamella report "
            f"{opened.folder}"
        )
        raise StoreError(message)
    server = get_server("lamella", client_type="vue3")
    server.state.update(
        {
            "room": ROOMS[0].TITLE,
            "configuration": names[0],
            "configurations": names,
            "trame__title": results.name,
            "tabs": 1,
        }
    )
    for own in ROOMS:
        own.room(server, opened)
    with SinglePageLayout(server, full_height=True) as layout:
        client.Script((files("updating.report") / "rest.js").read_text(encoding="utf-8"))
        for name in ("history.js", "names.js"):
            client.Script((files("updating.workbench") / name).read_text(encoding="utf-8"))
        client.Style(_STYLE)
        layout.title.set_text(results.name)
        layout.icon.hide()
        with layout.toolbar:
            vuetify3.VSpacer()
            vuetify3.VSelect(
                v_model=("configuration",), items=("configurations",), label="Configuration", density="compact",
                hide_details=True, style="max-width: 220px", id="configuration",
            )  # fmt: skip
        layout.footer.hide()
        with layout.content, vuetify3.VContainer(fluid=True):
            vuetify3.VAlert(
                "This page is open in {{ tabs }} tabs, which show the same: what you do in one, the others follow.",
                v_if="tabs > 1", type="info", density="compact", variant="tonal", classes="mb-2", id="tabs",
            )  # fmt: skip
            with vuetify3.VTabs(v_model=("room",), show_arrows=True):
                for own in ROOMS:
                    vuetify3.VTab(own.TITLE, value=own.TITLE, prepend_icon=own.ICON)
            with vuetify3.VWindow(v_model=("room",), classes="pt-3"):
                for own in ROOMS:
                    with vuetify3.VWindowItem(
                        value=own.TITLE, transition=("false",), reverse_transition=("false",)
                    ):
                        own.show(server)
    return server
