"""Access control: token, Host and Origin are checked for every request and websocket."""

from __future__ import annotations

import hmac
import ipaddress
import re
import secrets
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, quote, unquote, urlsplit

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

_OWN_HEADER = "x-head-tracking"
"""Pages of other sites can't send this header: browsers ask the server first (CORS)."""

_HEADERS = (
    (b"content-security-policy", b"frame-ancestors 'none'"),
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
)


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

    def __init__(self, app: App, host: str, token: str = "") -> None:
        self._app = app
        self._is_local = is_loopback(host)
        self.token = "" if self._is_local else token or secrets.token_urlsafe(12)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse a request, or let the app answer it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {
            name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]
        }
        query = bytes(scope.get("query_string", b"")).decode("latin-1")
        refusal = self.refusal(headers, query, str(scope.get("method", "")))
        if refusal and scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
            return
        if refusal:
            body = refusal.encode()
            kind = (b"content-type", b"text/plain; charset=utf-8")
            await send({"type": "http.response.start", "status": 403, "headers": [kind, *_HEADERS]})
            await send({"type": "http.response.body", "body": body})
            return

        async def send_protected(message: Message) -> None:
            if message["type"] == "http.response.start":
                message = {**message, "headers": [*message.get("headers", ()), *_HEADERS]}
                if self.token:
                    message["headers"].append((b"set-cookie", self._cookie(headers).encode()))
            await send(message)

        await self._app(scope, receive, send_protected)

    def refusal(self, headers: Mapping[str, str], query: str = "", method: str = "") -> str:
        """Return why a request is refused; empty if it is allowed.

        Args:
            headers: by name in lower case.
            query: the address after the question mark.
            method: of HTTP; empty: a websocket is opened.
        """
        host, origin = headers.get("host", "").lower(), headers.get("origin")
        if self._is_local and not is_loopback(_name(host)):
            return f"The page is served on this machine only, not as {host!r}: see `host`.\n"
        if origin is not None and origin.partition("://")[2].lower() != host:
            return f"Pages of {origin} must not steer this robot.\n"
        if method == "POST" and headers.get(_OWN_HEADER) != "page":
            return "Only the page itself may send commands.\n"
        if self.token and not self._has_token(headers, query):
            return "Token needed: open the address with ?token=... from the log of the viewer.\n"
        return ""

    def _has_token(self, headers: Mapping[str, str], query: str) -> bool:
        presented = parse_qs(query).get("token", [])
        try:
            cookie = SimpleCookie(headers.get("cookie", "")).get(cookie_name(headers))
        except CookieError:
            cookie = None
        presented += [] if cookie is None else [unquote(cookie.value)]
        return any(hmac.compare_digest(one.encode(), self.token.encode()) for one in presented)

    def _cookie(self, headers: Mapping[str, str]) -> str:
        value = quote(self.token)
        return f"{cookie_name(headers)}={value}; HttpOnly; SameSite=Strict; Path=/"


def cookie_name(headers: Mapping[str, str]) -> str:
    """Return the name of the cookie with the token, one for each port.

    Browsers send the cookies of a host to all its ports.
    """
    return "head_tracking_token_" + re.sub("[^0-9a-z]", "_", headers.get("host", "").lower())


def is_loopback(host: str) -> bool:
    """Return whether an address can be reached from this machine only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _name(host: str) -> str:
    """Return the name in a Host header, without its port; empty if it is malformed."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""
