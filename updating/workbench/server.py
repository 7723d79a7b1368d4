"""The workbench as a process: its page in the browser, and who may read it."""

from __future__ import annotations

import os
import secrets
import webbrowser
from collections.abc import Awaitable, Callable
from importlib.resources import files
from typing import Any

from updating.errors import StoreError
from updating.report.answer import changed_first
from updating.workbench import (
    comparison_panel,
    diagnosis_panel,
    identification_panel,
    measurement_panel,
    report_panel,
    what_if_panel,
)
from updating.workbench.opened import Opened

HOST = "127.0.0.1"


def address(token: str, port: int) -> str:
    """Return the address of the page, with the token."""
    place = f"{HOST}:{port}"
    return f"http://{place}/index.html?sessionURL=ws://{place}/ws&secret={token}"


def guard(token: str, port: Callable[[], int], seen: Callable[[int], None]) -> Any:
    """Return a middleware that answers 403 to whatever does not come with the token.

    The address that is opened carries the token; what it answers with sets a cookie, which the page's own requests,
    its websocket among them, then carry. A page of another origin cannot make the browser send it (SameSite), and a
    name that was bent to this machine is refused by its Host. The page takes the token out of the address; loaded
    again without it, as by F5 or the browser's history, the cookie stands for it.

    Parameters
    ----------
    token : str
        The token.
    port : callable
        Returns the port that the server listens at; it is known only after the start.
    seen : callable
        Takes the number of tabs that show the page, each time that it changes.
    """
    from aiohttp import web

    tabs = 0

    async def counted(
        request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Hold a tab's connection, which is answered when it ends."""
        nonlocal tabs
        tabs += 1
        seen(tabs)
        try:
            return await handler(request)
        finally:
            tabs -= 1
            seen(tabs)

    @web.middleware
    async def check(
        request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        name = f"lamella_{port()}"
        given = request.query.get("secret"), request.cookies.get(name)
        known = any(secrets.compare_digest(secret.encode(), token.encode()) for secret in given if secret is not None)
        if not known or request.host not in (f"{HOST}:{port()}", f"localhost:{port()}"):
            return web.Response(status=403, text="403: this address has no or a wrong token\n")
        if request.path == "/ws":
            return await counted(request, handler)
        if request.path in ("/", "/index.html") and "sessionURL" not in request.query:
            return web.HTTPFound(address(token, port()))
        response = await handler(request)
        if not response.prepared:
            response.set_cookie(name, token, httponly=True, samesite="Strict")
        return response

    return check


PANELS = (measurement_panel, identification_panel, comparison_panel, what_if_panel, diagnosis_panel, report_panel)

_STYLE = """
.v-field-label { opacity: 1 !important; color: #42526b; }
.stale { opacity: 0.78; filter: grayscale(1); }
"""
"""Labels with enough contrast, and results in grey that a command is about to replace."""


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
    token = secrets.token_urlsafe(24)  # bytes of chance

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
    """Build the page with all panels."""
    from trame.app import get_server
    from trame.ui.vuetify3 import SinglePageLayout
    from trame.widgets import client, vuetify3

    results = opened.results()
    names = [tested.name for tested in results.tested]
    if not names:
        raise StoreError(
            f"{opened.folder}: a table of modes has no functions or shapes to open; make its page with: lamella report "
            f"{opened.folder}"
        )
    server = get_server("lamella", client_type="vue3")
    server.state.update(
        {
            "panel": PANELS[0].TITLE,
            "configuration": changed_first(results)[0].name,
            "configurations": names,
            "trame__title": results.name,
            "tabs": 1,
        }
    )
    for panel in PANELS:
        panel.panel(server, opened)
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
            with vuetify3.VTabs(v_model=("panel",), show_arrows=True):
                for panel in PANELS:
                    vuetify3.VTab(panel.TITLE, value=panel.TITLE, prepend_icon=panel.ICON)
            with vuetify3.VWindow(v_model=("panel",), classes="pt-3"):
                for panel in PANELS:
                    with vuetify3.VWindowItem(value=panel.TITLE, transition=("false",), reverse_transition=("false",)):
                        panel.show(server)
    return server
