"""viser's server with a door: who may come in, and what is answered beside viser's own page.

STOP and what the badge says take this way, not viser's: its callbacks share some threads, and a
request that waits for another node keeps one of them.
"""

from __future__ import annotations

import asyncio
import gzip
import hmac
import http
import ipaddress
import json
import re
import secrets
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import parse_qs, quote, unquote, urlsplit

from websockets.asyncio import server as websocket_server

Query = Mapping[str, str]
"""What stands behind the question mark of an address."""


class File(NamedTuple):
    """An answer that is no JSON.

    Attributes:
        kind: its MIME type.
        data: what is in it; empty: nothing new.
        headers: what is told along with it.
    """

    kind: str
    data: bytes
    headers: Mapping[str, str] = {}


Action = Callable[[Query], Mapping[str, Any] | File]

_BAR = Path(__file__).with_name("bar.js")
_SCRIPT = "application/javascript; charset=utf-8"
_MARK = "X-Head-Tracking"
"""A header that pages of other sites can't send without being asked first (CORS)."""

_LARGEST_UPLOAD = 64 * 1024 * 1024  # bytes


class Door:
    """Looks at all requests to one server, and answers some.

    Args:
        host: the address that it listens on. Beyond this machine a token is asked for.
        token: the token; empty: one is made.
        limit: how many browsers may watch at a time.
        actions: by path, what answers a request that the page's own script has made.

    Attributes:
        stands: whether the server asks it.
        token: what a browser from another machine must know; empty: nothing is asked.
    """

    def __init__(
        self,
        host: str,
        token: str = "",
        limit: int = 8,
        actions: Mapping[str, Action] | None = None,
    ) -> None:
        self._local = is_loopback(host)
        self.token = "" if self._local else token or secrets.token_urlsafe(12)
        self.stands = False
        self._limit = limit
        self._actions = dict(actions or {})
        self._workers = {path: ThreadPoolExecutor(4) for path in self._actions}
        self._watching: set[Any] = set()
        self._index: tuple[bytes, bytes] | None = None

    def refusal(self, headers: Mapping[str, str], path: str = "/") -> str:
        """Why a request is refused; empty if it is not.

        The Origin, which browsers send and pages cannot change, must be the page's own address
        (RFC 6455, section 10.2); programs send none. A page that only this machine may open
        goes by no other name: a site could let its own name point to 127.0.0.1. Elsewhere the
        token keeps such a site out: it has no cookie of this page.
        """
        host, origin = headers.get("Host", "").lower(), headers.get("Origin")
        if self._local and not is_loopback(urlsplit(f"//{host}").hostname or ""):
            return f"the viewer listens on this machine only, and not as {host!r}; see `host`\n"
        if origin is not None and urlsplit(origin).netloc.lower() != host:
            return f"pages of {origin} may not steer this robot\n"
        if self.token and not self._knows_token(headers, path):
            return (
                "this robot asks for a token: open the address with ?token=... that the viewer "
                "wrote into its log\n"
            )
        return ""

    async def look(self, connection: Any, request: Any, serve: Callable[[Any, Any], Any]) -> Any:
        """Answers a request, or lets viser do so."""
        response = await self._answer(connection, request, serve)
        return None if response is None else self._dressed(response, request.headers)

    async def _answer(self, connection: Any, request: Any, serve: Callable[[Any, Any], Any]) -> Any:
        refusal = self.refusal(request.headers, request.path)
        if refusal:
            return connection.respond(http.HTTPStatus.FORBIDDEN, refusal)
        path = urlsplit(request.path).path
        if path in self._actions:
            return await self._act(connection, request, path)
        if path == "/head/bar.js":
            return self._file(connection, File(_SCRIPT, _BAR.read_bytes()))
        enters = request.headers.get("Upgrade", "").lower() == "websocket"
        if len(self._watching) >= self._limit and (enters or path == "/"):
            return connection.respond(
                http.HTTPStatus.SERVICE_UNAVAILABLE,
                f"{len(self._watching)} browsers watch this robot already, and more are not "
                "let in (max_browsers); close one and load this page again\n",
            )
        if enters:
            self._count(connection)
        response = serve(connection, request)
        if response is not None and path in ("/", "/index.html"):
            self._add_bar(response)
        return response

    def _knows_token(self, headers: Mapping[str, str], path: str) -> bool:
        said = parse_qs(urlsplit(path).query).get("token", [])
        cookies = (pair.partition("=") for pair in headers.get("Cookie", "").split(";"))
        said += [unquote(value) for name, _, value in cookies if name.strip() == _cookie(headers)]
        return any(hmac.compare_digest(one.encode(), self.token.encode()) for one in said)

    def _count(self, connection: Any) -> None:
        self._watching.add(connection)
        task = asyncio.get_running_loop().create_task(connection.wait_closed())
        task.add_done_callback(lambda _: self._watching.discard(connection))

    async def _act(self, connection: Any, request: Any, path: str) -> Any:
        if request.headers.get(_MARK) != "page":
            return connection.respond(http.HTTPStatus.FORBIDDEN, "only the page itself may\n")
        query = {
            name: values[-1]
            for name, values in parse_qs(urlsplit(request.path).query, True).items()
        }
        loop = asyncio.get_running_loop()
        answer = await loop.run_in_executor(self._workers[path], self._actions[path], query)
        if not isinstance(answer, File):
            answer = File("application/json", json.dumps(answer).encode())
        return self._file(connection, answer)

    def _file(self, connection: Any, file: File) -> Any:
        status = http.HTTPStatus.OK if file.data else http.HTTPStatus.NO_CONTENT
        response = connection.respond(status, "")
        response.body = file.data
        about = {"Content-Type": file.kind, "Content-Length": str(len(file.data)), **file.headers}
        for name, value in about.items():
            response.headers.pop(name, None)
            response.headers[name] = value
        return response

    def _add_bar(self, response: Any) -> None:
        packed = response.headers.get("Content-Encoding") == "gzip"
        if self._index is None:
            text = gzip.decompress(response.body) if packed else response.body
            text = text.replace(b"</head>", b'<script src="head/bar.js"></script></head>', 1)
            self._index = text, gzip.compress(text)
        response.body = self._index[packed]
        del response.headers["Content-Length"]
        response.headers["Content-Length"] = str(len(response.body))

    def _dressed(self, response: Any, headers: Mapping[str, str]) -> Any:
        """With what keeps a page of another site from putting this one into a frame."""
        response.headers["Content-Security-Policy"] = "frame-ancestors 'none'"
        response.headers["X-Frame-Options"] = "DENY"
        response.headers["Cache-Control"] = "no-store"
        if self.token and response.status_code == http.HTTPStatus.OK:
            response.headers["Set-Cookie"] = (
                f"{_cookie(headers)}={quote(self.token)}; HttpOnly; SameSite=Strict; Path=/"
            )
        return response


def _cookie(headers: Mapping[str, str]) -> str:
    """Return the cookie's name: browsers send all cookies of a host to each of its ports."""
    return "head_tracking_token_" + re.sub("[^0-9a-z]", "_", headers.get("Host", "").lower())


@contextmanager
def guarded(door: Door) -> Iterator[None]:
    """Puts a door before the server that viser starts within the block.

    viser takes no options for websockets' `serve`, so that is wrapped until viser has called it.
    """
    serve = websocket_server.serve

    def guarded_serve(*arguments: Any, process_request: Any, **options: Any) -> Any:
        async def look(connection: Any, request: Any) -> Any:
            return await door.look(connection, request, process_request)

        door.stands = True
        return serve(*arguments, process_request=look, **options)

    vars(websocket_server)["serve"] = guarded_serve
    try:
        yield
    finally:
        vars(websocket_server)["serve"] = serve


def limit_uploads(server: Any, refuse: Callable[[int, str], None]) -> None:
    """Keeps viser from holding files in memory that are too large to be recordings.

    And from telling all browsers, those that come later too, how the upload of one goes: they show
    it as a file without a name.

    Args:
        server: viser's.
        refuse: is told which client was refused, and why.
    """
    handlers = server._websock_server._incoming_handlers
    uploads = server.gui._current_file_upload_states

    def size_with(message: Any) -> int:
        """Return what a sender declares, or sends, with what has come of all uploads."""
        held: int = sum(one["transferred_bytes"] for one in uploads.values())
        return held + int(getattr(message, "size_bytes", 0)) + len(getattr(message, "content", b""))

    def checked(handler: Callable[[int, Any], Any]) -> Callable[[int, Any], None]:
        def handle(client: int, message: Any) -> None:
            if size_with(message) <= _LARGEST_UPLOAD:
                handler(client, message)
                return
            uploads.pop(message.transfer_uuid, None)
            largest = f"{_LARGEST_UPLOAD / 1e6:.0f} MB"
            refuse(client, f"the file is too large for a recording: up to {largest} are taken")

        return handle

    for kind, registered in handlers.items():
        if kind.__name__ in ("FileTransferStartUpload", "FileTransferPart"):
            handlers[kind] = [checked(handler) for handler in registered]
    tell_all = server._websock_server.queue_message

    def tell(message: Any) -> None:
        if type(message).__name__ != "FileTransferPartAck":
            tell_all(message)
            return
        upload = server.gui._current_file_upload_states.get(message.transfer_uuid)
        client = None if upload is None else server.get_clients().get(upload["client_id"])
        if client is not None:
            client._websock_connection.queue_message(message)

    server._websock_server.queue_message = tell


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
