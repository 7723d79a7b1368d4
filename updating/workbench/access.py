"""Who may see the workbench: a browser on this machine that was given the address with its token."""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable
from typing import Any

HOST = "127.0.0.1"
_BYTES = 24  # of chance in a token


def new_token() -> str:
    """Return a token that nobody can guess."""
    return secrets.token_urlsafe(_BYTES)


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
        known = any(secrets.compare_digest(own.encode(), token.encode()) for own in given if own is not None)
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
