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


def guard(token: str, port: Callable[[], int]) -> Any:
    """Return a middleware that answers 403 to whatever does not come with the token.

    The address that is opened carries the token; what it answers with sets a cookie, which the page's own requests,
    its websocket among them, then carry. A page of another origin cannot make the browser send it (SameSite), and a
    name that was bent to this machine is refused by its Host.

    Parameters
    ----------
    token : str
        The token.
    port : callable
        Returns the port that the server listens at; it is known only after the start.
    """
    from aiohttp import web

    @web.middleware
    async def check(
        request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        name = f"lamella_{port()}"
        given = request.query.get("secret"), request.cookies.get(name)
        known = any(secrets.compare_digest(own.encode(), token.encode()) for own in given if own is not None)
        if not known or request.host not in (f"{HOST}:{port()}", f"localhost:{port()}"):
            return web.Response(status=403, text="403: this address has no or a wrong token\n")
        response = await handler(request)
        if not response.prepared:
            response.set_cookie(name, token, httponly=True, samesite="Strict")
        return response

    return check
