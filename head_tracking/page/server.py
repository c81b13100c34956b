"""The server of the page: STOP, commands, live states and pictures, on one event loop."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import socket
import sys
import tempfile
import threading
import time
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from head_tracking.exceptions import HeadTrackingError
from head_tracking.page.access import Access
from head_tracking.page.commands import commands
from head_tracking.page.live import Live
from head_tracking.page.replay import Replays
from head_tracking.page.robot import Robot
from head_tracking.page.stop import ANSWER, Attempt
from head_tracking.page.tuning import Tuning
from head_tracking.parameters import ParameterError, parameter
from head_tracking.recording.recording import RecordingError

_STATIC = Path(__file__).with_name("static")

_LARGEST_REQUEST = 64 * 1024  # bytes
_LARGEST_RECORDING = 256 * 1024 * 1024  # bytes that may be uploaded
_UPLOADS = 3  # at a time; others wait
_SILENT = 30.0  # s without a part of the body until a request is refused
_START, _END = 10.0, 2.0  # s
_PORTS = 20  # that are tried
_PACE, _BURST = 0.005, 0.2  # s between two requests; eight browsers send one in 0.008 s at most
_MESSAGES = 200.0  # per second; a browser sends one for each state
_RECEIVED = 16 * 1024  # bytes of a connection that wait: they are parsed before others are served
_PERIOD, _UNWATCHED = 0.05, 0.5  # s between samples for browsers, and between polls without

_LAST = 50  # the number of requests after which one ends its connection: uvicorn reads on for each
_SWITCH = 0.0005  # s until a busy thread lets another one run, such as that of STOP

_AT_ONCE = ("/head/stop", "/head/resume")

_REFUSED = (
    *(HeadTrackingError, ArithmeticError, LookupError, OSError, TypeError, ValueError),
    RecursionError,  # of JSON that is nested too deep
)

Answer = Callable[[dict[str, Any]], Any]
"""Returns the answer to a request by its fields: a Response, or what JSON can hold.

A text or None tells that a command was carried out. Raises one of `_REFUSED` if it was not.
"""


@dataclass(frozen=True, slots=True)
class PageParameters:
    """Where the page is, and for how many browsers."""

    host: str = parameter(
        "127.0.0.1",
        "Address to listen on; 0.0.0.0 lets the whole network steer the robot.",
        fixed=True,
    )
    port: int = parameter(8080, "Port to listen on.", minimum=0, maximum=65535, fixed=True)
    token: str = parameter(
        "",
        "What a browser on another machine must present to open the page; empty: a new one for "
        "each run, which is logged. Not needed on 127.0.0.1.",
        fixed=True,
    )
    max_browsers: int = parameter(
        8, "Browsers that may show the page at a time.", minimum=1, maximum=100, fixed=True
    )
    horizontal_view: float = parameter(
        1.0,
        "Angle of the camera's picture from side to side, if its calibration is not published.",
        unit="rad",
        minimum=0.05,
        maximum=3.0,
        fixed=True,
    )


class Page:
    """Serves the page from a thread of its own until it is closed.

    Sampling and commands run in threads beside the event loop, which itself begins each STOP and
    awaits its end. NiceGUI's wheel contains Starlette, three.js and the fonts; nothing else of it
    is used.

    Attributes:
        port: that the page listens on.
        token: that a browser on another machine must present; empty: none.
        browsers: that watch now, each with what it wants to be sent.

    Raises:
        ParameterError: the address can't be listened on.
    """

    def __init__(
        self, robot: Robot, parameters: PageParameters, report: Callable[[str], None]
    ) -> None:
        self._robot = robot
        self._live = Live(robot, parameters.horizontal_view, report)
        self._replays = Replays(robot)
        self._limit = parameters.max_browsers
        self.browsers: dict[WebSocket, _Watcher] = {}
        self._sampled, self._arrived = asyncio.Event(), asyncio.Event()
        self._next_turn, self._requests = 0.0, 0
        self._uploads = asyncio.Semaphore(_UPLOADS)
        self._stopping: tuple[Attempt, asyncio.Future[None]] | None = None
        self._resuming = ThreadPoolExecutor(8, "resume")
        self._working = ThreadPoolExecutor(8, "command")
        self._reading = ThreadPoolExecutor(1, "recording")  # several would leave STOP no processor
        sys.setswitchinterval(_SWITCH)
        self._socket = _listening(parameters.host, parameters.port)
        app = Starlette(
            routes=self._routes(),
            lifespan=self._lifespan,
            exception_handlers=dict.fromkeys(_REFUSED, _refuse),
        )
        self._access = Access(app, parameters.host, parameters.token)
        self.port, self.token = int(self._socket.getsockname()[1]), self._access.token
        self._server = uvicorn.Server(
            uvicorn.Config(
                self._answer,
                interface="asgi3",
                http="h11",  # httptools reads more pipelined requests than it answers
                log_level="critical",
                access_log=False,
                ws_max_size=_LARGEST_REQUEST,
                ws_per_message_deflate=False,  # it would cost more than all else that is sent
                timeout_graceful_shutdown=1,
            )
        )
        self._thread = threading.Thread(
            target=self._server.run, args=([self._socket],), name="page", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """End the page; the robot goes on."""
        self._server.should_exit = True
        self._thread.join(_START + _END)
        for threads in (self._resuming, self._working, self._reading):
            threads.shutdown(wait=False, cancel_futures=True)

    @contextlib.asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        sampling = asyncio.create_task(self._sample())
        yield
        sampling.cancel()

    async def _sample(self) -> None:
        """Sample the robot for all browsers; while none watches, only receive what has come."""
        loop = asyncio.get_running_loop()
        while True:
            self._arrived.clear()
            start, watchers = time.monotonic(), list(self.browsers.values())
            if watchers:
                topics = {one.topic for one in watchers if one.topic is not None}
                await loop.run_in_executor(None, self._live.sample, topics)
                self._sampled.set()
                self._sampled = asyncio.Event()
                await asyncio.sleep(max(start + _PERIOD - time.monotonic(), 0.1 * _PERIOD))
            else:
                await loop.run_in_executor(None, self._live.poll)
                with contextlib.suppress(asyncio.TimeoutError):
                    await asyncio.wait_for(self._arrived.wait(), _UNWATCHED)

    def _routes(self) -> list[BaseRoute]:
        robot, live, replays = self._robot, self._live, self._replays
        tuning = Tuning(robot.parameters)
        get: dict[str, Answer] = {
            "mesh/{number:int}": lambda at: _mesh(live.meshes, at["number"]),
            "parameters": lambda _: {
                "presets": tuning.presets(),
                "preset": tuning.chosen(),
                "parameters": tuning.listed(),
            },
            "recordings": lambda _: [
                {"name": file.name, "size": file.stat().st_size} for file in robot.recorder.files()
            ],
            "recordings/{name}": lambda at: FileResponse(
                self._recording(at["name"]), media_type="application/mcap", filename=at["name"]
            ),
            "replay/{key}/at": lambda at: replays.at(at["key"], float(at["time"])),
            "replay/{key}/picture": lambda at: _picture(
                replays.picture(at["key"], float(at["time"]))
            ),
            "replay/{key}/mesh/{number:int}": lambda at: _mesh(
                replays.meshes(at["key"]), at["number"]
            ),
        }
        post: dict[str, Answer] = {
            f"do/{name}": command for name, command in commands(robot, live, tuning).items()
        }

        def open_recording(fields: dict[str, Any]) -> Any:
            with self._recording(str(fields["name"])).open("rb") as file:
                return replays.open(file)

        return [
            Route("/head/stop", self._stop, methods=["POST"]),
            self._route("POST", "resume", lambda _: robot.stop.resume(), self._resuming),
            Mount("/head/static", StaticFiles(directory=_STATIC)),
            # without importing nicegui, which would take a second
            Mount("/head/three", StaticFiles(packages=[("nicegui", "elements/scene/dist")])),
            Mount("/head/font", StaticFiles(packages=[("nicegui", "static")])),
            Route("/", lambda _: FileResponse(_STATIC / "page.html")),
            *(self._route("GET", *one, self._working) for one in get.items()),
            *(self._route("POST", *one, self._working) for one in post.items()),
            self._route("POST", "replay/open", open_recording, self._reading),
            Route("/head/replay/upload", self._upload, methods=["POST"]),
            WebSocketRoute("/head/live", self._watch),
        ]

    async def _stop(self, _: Request) -> Response:
        """Begin a STOP, or join the one in progress; no thread waits for its end."""
        attempt = self._robot.stop_everything()
        if self._stopping is None or self._stopping[0] is not attempt:
            self._stopping = attempt, asyncio.wrap_future(attempt.ended)
        await asyncio.wait([self._stopping[1]], timeout=ANSWER)
        return JSONResponse(attempt.outcome._asdict())

    def _route(self, method: str, path: str, answer: Answer, threads: ThreadPoolExecutor) -> Route:
        """Return the route of requests that are answered in one of these threads."""

        async def respond(request: Request) -> Response:
            fields = {**request.query_params, **await _fields(request), **request.path_params}
            return await _respond(threads, answer, fields)

        return Route(f"/head/{path}", respond, methods=[method])

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request; a flood of others leaves the processor to STOP."""
        if scope["type"] != "lifespan" and scope["path"] not in _AT_ONCE:
            now = time.monotonic()
            self._next_turn = max(self._next_turn + _PACE, now - _BURST)
            self._requests += 1
            if self._requests % _LAST == 0:  # uvicorn ends the connection, with what waits there
                scope["headers"] = [*scope["headers"], (b"connection", b"close")]
            await asyncio.sleep(self._next_turn - now)
        await self._access(scope, receive, send)

    def _recording(self, name: str) -> Path:
        """Return one of the listed recordings by its name.

        Raises:
            RecordingError: there is none.
        """
        for file in self._robot.recorder.files():
            if file.name == name:
                return file
        raise RecordingError(f"There is no recording {name!r}.")

    async def _upload(self, request: Request) -> Response:
        """Open a recording that a browser sends, up to a size that is counted while it comes."""
        async with self._uploads:
            with tempfile.TemporaryFile() as file:
                loop = asyncio.get_running_loop()
                async for chunk in _chunks(request, _LARGEST_RECORDING):
                    await loop.run_in_executor(self._working, file.write, chunk)
                file.seek(0)
                return await _respond(self._reading, self._replays.open, file)

    async def _watch(self, browser: WebSocket) -> None:
        """Send states and pictures to a browser. A slow one skips those it has no time for.

        Else they would queue before the answer to its STOP, and show what was long ago.
        """
        await browser.accept()
        if len(self.browsers) >= self._limit:
            await browser.close(4008, "too many browsers watch this robot (max_browsers)")
            return
        watcher = self.browsers[browser] = _Watcher()
        self._arrived.set()
        sending = asyncio.create_task(self._send(browser, watcher))
        try:
            while watcher.receive(await browser.receive_text()):
                await asyncio.sleep(0)  # a message that waits already would not let others run
            await browser.close(1008, "too many messages")
        except (WebSocketDisconnect, KeyError, RuntimeError):
            pass
        finally:
            del self.browsers[browser]
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    async def _send(self, browser: WebSocket, watcher: _Watcher) -> None:
        live, texts, sent = self._live, {"robot": ""}, None
        while True:
            await self._sampled.wait()
            if not watcher.ready:
                continue
            watcher.ready, topic = False, watcher.topic
            picture = None if topic is None else live.pictures.get(topic)
            if picture not in (None, sent):
                sent = picture
                await browser.send_bytes(picture[1])
            for kind, text in live.texts.items():
                if texts.get(kind) != text or kind == "state":  # the last one, sent always
                    texts[kind] = text
                    await browser.send_text(text)


class _Watcher:
    """What a browser wants to be sent.

    Attributes:
        ready: whether it has shown the last state, which comes after all else.
        topic: of its pictures; empty: the default one; None: no pictures.
    """

    def __init__(self) -> None:
        self.ready = True
        self.topic: str | None = ""
        self._due = 0.0

    def receive(self, text: str) -> bool:
        """Receive what the browser sends: `got` after each state, or a topic.

        Returns:
            False if it sends too many messages.
        """
        now = time.monotonic()
        self._due = max(self._due, now - 1.0) + 1.0 / _MESSAGES
        if text == "got":
            self.ready = True
        elif text.startswith("camera "):
            self.topic = text.removeprefix("camera ")
        elif text == "blind":
            self.topic = None
        return self._due <= now


class _TooLargeError(ValueError):
    """A request has more bytes than allowed."""


async def _chunks(request: Request, limit: int) -> AsyncIterator[bytes]:
    """Yield the body of a request in parts.

    Raises:
        _TooLargeError: it has more than `limit` [bytes].
        ValueError: the next part does not come.
    """
    size, parts = 0, aiter(request.stream())
    try:
        while chunk := await asyncio.wait_for(anext(parts, b""), _SILENT):
            size += len(chunk)
            if size > limit:
                raise _TooLargeError(f"At most {limit} bytes are allowed.")
            yield chunk
    except asyncio.TimeoutError:
        raise ValueError(f"Nothing has come for {_SILENT:g} s.") from None


async def _fields(request: Request) -> dict[str, Any]:
    """Return the JSON object in the body of a request; raise ValueError if it has another one."""
    body = b"".join([chunk async for chunk in _chunks(request, _LARGEST_REQUEST)])
    fields = json.loads(body or b"{}")
    if not isinstance(fields, dict):
        raise ValueError("The body must be a JSON object.")
    return fields


async def _respond(threads: ThreadPoolExecutor, answer: Callable[[Any], Any], of: Any) -> Response:
    """Return what a function answers in a thread as a response."""
    found = await asyncio.get_running_loop().run_in_executor(threads, answer, of)
    if isinstance(found, Response):
        return found
    is_done = found is None or isinstance(found, str)
    return JSONResponse({"done": True, "text": found or ""} if is_done else found)


async def _refuse(request: Request, error: Exception) -> Response:
    """Return the answer to a request with wrong fields or too many bytes, or to a refused one."""
    text = f"{error.args[0]!r} is missing." if isinstance(error, KeyError) else str(error)
    is_too_large = isinstance(error, _TooLargeError)
    status = 413 if is_too_large else 404 if request.method == "GET" else 400
    return JSONResponse({"done": False, "text": text}, status)


def _mesh(meshes: tuple[bytes, ...], number: int) -> Response:
    return Response(meshes[number], media_type="model/stl")


def _picture(picture: bytes | None) -> Response:
    return Response(picture, status_code=204 if picture is None else 200)


def _listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens at an address, on the next free port if the port is taken.

    Raises:
        ParameterError: the address can't be listened on.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    for number in range(port, min(port + _PORTS, 65536)) if port else (0,):
        try:
            listening = socket.create_server((host, number), family=family, backlog=128)
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVED)  # of connections
            return listening
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise ParameterError(
                    f"The page can't listen on {host!r}, port {port}: {error}. Give 127.0.0.1, "
                    "0.0.0.0 or an address of this machine."
                ) from error
    raise ParameterError(f"The ports {port} to {number} are taken: give another `port`.")
