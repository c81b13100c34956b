"""Access control: token, Host and Origin are checked for every request and websocket."""

from __future__ import annotations

import hmac
import ipaddress
import re
import secrets
import socket
from contextlib import suppress
from typing import Final
from urllib.parse import quote, unquote, urlsplit

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_OWN_HEADER = "x-head-tracking"
"""Pages of other sites can't send this header: browsers ask the server first (CORS)."""

_HEADERS: Final = {
    "content-security-policy": "frame-ancestors 'none'",
    "x-frame-options": "DENY",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cache-control": "no-cache",  # ask whether it has changed: another version may be served now
}


class Access:
    """ASGI middleware that refuses requests from other sites and without the token.

    The Origin, which browsers send and pages cannot change, must be the page's own address
    (RFC 6455, section 10.2); programs send none. A page that listens on a loopback address
    accepts no other Host: the name of another site could resolve to 127.0.0.1.

    Args:
        app: answers allowed requests.
        host: the address that the server listens on. Beyond loopback a token is required.
        token: the token; empty: a random one.

    Attributes:
        token: that a browser on another machine must present; empty: none.
    """

    def __init__(self, app: ASGIApp, host: str, token: str = "") -> None:
        self._app = app
        self.token = "" if is_loopback(host) else token or secrets.token_urlsafe(12)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse a request, or let the app answer it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        request, token = HTTPConnection(scope), self.token
        refusal = self._refusal(request)
        if refusal:
            await PlainTextResponse(refusal, 403, _HEADERS)(scope, receive, send)
            return

        async def send_protected(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(_HEADERS)
                if token:
                    cookie = f"{_cookie_name(request)}={quote(token)}"
                    headers.append("set-cookie", f"{cookie}; HttpOnly; SameSite=Strict; Path=/")
            await send(message)

        await self._app(scope, receive, send_protected)

    def _refusal(self, request: HTTPConnection) -> str:
        """Return why a request is refused; empty if it is allowed."""
        host, origin = _host(request), request.headers.get("origin")
        if not self.token and not is_loopback(_name(host)):
            return f"The page is served on this machine only, not as {host!r}: see `host`.\n"
        if origin is not None and origin.partition("://")[2].lower() != host:
            return f"Pages of {origin} must not steer this robot.\n"
        is_post = request.scope.get("method") == "POST"
        if is_post and request.headers.get(_OWN_HEADER) != "page":
            return "Only the page itself may send commands.\n"
        if self.token and not self._has_token(request):
            return "Token needed: open the address with ?token=... from the log of the viewer.\n"
        return ""

    def _has_token(self, request: HTTPConnection) -> bool:
        presented = request.query_params.getlist("token")
        presented.append(unquote(request.cookies.get(_cookie_name(request), "")))
        return any(hmac.compare_digest(one.encode(), self.token.encode()) for one in presented)


def _host(request: HTTPConnection) -> str:
    return str(request.headers.get("host", "")).lower()


def _cookie_name(request: HTTPConnection) -> str:
    """Return the name of the cookie with the token, one for each port.

    Browsers send the cookies of a host to all its ports.
    """
    return "head_tracking_token_" + re.sub("[^0-9a-z]", "_", _host(request))


def is_loopback(host: str) -> bool:
    """Return whether an address can be reached from this machine only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def reached_at(host: str) -> str:
    """Return the name in the URL of a server that listens on an address."""
    if host in ("0.0.0.0", "::"):  # all addresses: the one that the network has
        with socket.socket(type=socket.SOCK_DGRAM) as probe, suppress(OSError):
            probe.connect(("192.0.2.1", 9))  # sends nothing (RFC 5737)
            return str(probe.getsockname()[0])
        host = "127.0.0.1"  # there is no network
    return "localhost" if host == "127.0.0.1" else f"[{host}]" if ":" in host else host


def _name(host: str) -> str:
    """Return the name in a Host header, without its port; empty if it is malformed."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""
