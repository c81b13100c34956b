"""Keeps the pages of other web sites away: a browser would let each of them steer the robot."""

from __future__ import annotations

import http
import ipaddress
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from websockets.asyncio import server as websocket_server


class Guard:
    """Looks at all requests to one server.

    Args:
        host: the address that it listens on.

    Attributes:
        stands: whether the server asks it.
    """

    def __init__(self, host: str) -> None:
        self._local = is_loopback(host)
        self.stands = False

    def refusal(self, headers: Mapping[str, str]) -> str:
        """Why a request is refused; empty if it is not.

        The Origin, which browsers send and pages cannot change, must be the page's own address
        (RFC 6455, section 10.2); programs send none. And a page that only this machine may open
        goes by no other name: a site could let its own name point to 127.0.0.1.
        """
        host, origin = headers.get("Host", "").lower(), headers.get("Origin")
        if self._local and not is_loopback(urlsplit(f"//{host}").hostname or ""):
            return f"the viewer listens on this machine only, and not as {host!r}; see `host`\n"
        if origin is not None and urlsplit(origin).netloc.lower() != host:
            return f"pages of {origin} may not steer this robot\n"
        return ""


@contextmanager
def guarded(host: str) -> Iterator[Guard]:
    """A guard for the server that viser starts within the block.

    viser takes no options for websockets' `serve`, so that is wrapped until viser has called it.
    """
    guard, serve = Guard(host), websocket_server.serve

    def guarded_serve(*arguments: Any, process_request: Any, **options: Any) -> Any:
        def look(connection: Any, request: Any) -> Any:
            refusal = guard.refusal(request.headers)
            if refusal:
                return connection.respond(http.HTTPStatus.FORBIDDEN, refusal)
            return process_request(connection, request)

        guard.stands = True
        return serve(*arguments, process_request=look, **options)

    vars(websocket_server)["serve"] = guarded_serve
    try:
        yield guard
    finally:
        vars(websocket_server)["serve"] = serve


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
