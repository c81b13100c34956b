"""The server of the page: STOP, commands, live states and pictures, on one event loop."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import socket
import tempfile
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import uvicorn
from fastapi import FastAPI, Request, Response, WebSocket, WebSocketDisconnect
from fastapi.responses import FileResponse
from fastapi.staticfiles import StaticFiles

from head_tracking.page.access import Access
from head_tracking.page.commands import Commands
from head_tracking.page.live import EncodedPicture, Live, ViewParameters
from head_tracking.page.replay import Replays
from head_tracking.page.robot import Robot
from head_tracking.page.robot_shapes import FindPackage
from head_tracking.page.tuning import PRESETS, Tuning
from head_tracking.parameters import ParameterError, parameter
from head_tracking.recording.recording import RecordingError
from head_tracking.ros.kit.other_services import Outcome

_STATIC = Path(__file__).with_name("static")
_OWN_HEADER = "x-head-tracking"
"""Pages of other sites can't send this header: browsers ask the server first (CORS)."""

_LARGEST_REQUEST = 64 * 1024  # bytes
_LARGEST_RECORDING = 256 * 1024 * 1024  # bytes that may be uploaded
_START, _END = 10.0, 2.0  # s
_PORTS = 20  # that are tried
_UNWATCHED = 0.2  # s between samples while no browser watches


@dataclass(frozen=True, slots=True)
class PageParameters:
    """Where the page is, and how often it is brought up to date."""

    host: str = parameter(
        "127.0.0.1",
        "Address to listen on; 0.0.0.0 lets the whole network steer the robot.",
        fixed=True,
    )
    port: int = parameter(8080, "Port to listen on.", minimum=0, maximum=65535, fixed=True)
    token: str = parameter(
        "",
        "What a browser on another machine must present to open the page; empty: a new one each "
        "time, which is logged. Not needed on 127.0.0.1.",
        fixed=True,
    )
    max_browsers: int = parameter(
        8, "Browsers that may show the page at a time.", minimum=1, maximum=100, fixed=True
    )
    rate: float = parameter(
        25.0, "States per second.", unit="Hz", minimum=1.0, maximum=60.0, fixed=True
    )


class Page:
    """Serves the page from a thread of its own until it is closed.

    Sampling and commands run in threads beside the event loop; STOP has threads that nothing else
    uses. NiceGUI's wheel contains FastAPI, three.js and the fonts; nothing else of it is used.

    Args:
        robot: is shown and steered.
        parameters: where and how often.
        view: what is drawn around the head.
        find_package: for meshes at package:// addresses.
        report: receives a text when a part of the page begins to fail.

    Raises:
        ParameterError: the address can't be listened on.
    """

    def __init__(
        self,
        robot: Robot,
        parameters: PageParameters,
        view: ViewParameters,
        find_package: FindPackage,
        report: Callable[[str], None],
    ) -> None:
        self._robot = robot
        self._live = Live(robot, find_package, view, report)
        self._tuning = Tuning(robot.parameters)
        self._replays = Replays(
            self._live.last_minute, robot.model, robot.head_of, self._live.describe
        )
        self._limit, self._period = parameters.max_browsers, 1.0 / parameters.rate
        self._browsers: dict[WebSocket, _Watcher] = {}
        self._state, self._sampled = "", asyncio.Event()
        self._pictures: dict[str, EncodedPicture] = {}
        self._stopping = ThreadPoolExecutor(4, "stop")
        self._working = ThreadPoolExecutor(8, "command")
        self._sampling = ThreadPoolExecutor(1, "sample")
        self._commands = Commands(robot, self._live, self._tuning)
        self._socket = _listening(parameters.host, parameters.port)
        app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
        self._add_routes(app)
        self._access = Access(app, parameters.host, parameters.token)
        self._server = uvicorn.Server(
            uvicorn.Config(
                self._access,
                log_level="critical",
                access_log=False,
                ws_max_size=_LARGEST_REQUEST,
                ws_per_message_deflate=False,  # it would cost more than all else that is sent
                timeout_graceful_shutdown=1,
            )
        )
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The port that the page listens on."""
        return int(self._socket.getsockname()[1])

    @property
    def token(self) -> str:
        """The token that a browser on another machine must present; empty: none."""
        return self._access.token

    @property
    def browsers(self) -> int:
        """How many browsers watch now."""
        return len(self._browsers)

    def close(self) -> None:
        """End the page; the robot goes on."""
        self._server.should_exit = True
        self._thread.join(_START + _END)
        for threads in (self._sampling, self._stopping, self._working):
            threads.shutdown(wait=threads is self._sampling, cancel_futures=True)

    def _run(self) -> None:
        asyncio.run(self._serve())

    async def _serve(self) -> None:
        sampling = asyncio.create_task(self._sample())
        try:
            await self._server.serve([self._socket])
        finally:
            sampling.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await sampling

    async def _sample(self) -> None:
        """Sample the robot for all browsers; rarely while no browser watches."""
        loop, live = asyncio.get_running_loop(), self._live
        while True:
            start = time.monotonic()
            if self._browsers:
                topics = {one.topic for one in self._browsers.values() if one.topic is not None}
                self._state, self._pictures = await loop.run_in_executor(
                    self._sampling, live.sample, topics
                )
                self._sampled.set()
                self._sampled = asyncio.Event()
            else:
                await loop.run_in_executor(self._sampling, live.observe)
            period = self._period if self._browsers else _UNWATCHED
            await asyncio.sleep(max(start + period - time.monotonic(), 0.1 * period))

    def _add_routes(self, app: FastAPI) -> None:
        def add(path: str, answer: Callable[..., Any], method: str = "GET") -> None:
            app.add_api_route(path, answer, methods=[method], response_model=None)

        app.mount("/head/static", StaticFiles(directory=_STATIC))
        app.mount("/head/three", StaticFiles(directory=_wheel() / "elements" / "scene" / "dist"))
        app.mount("/head/font", StaticFiles(directory=_wheel() / "static"))
        add("/", lambda: FileResponse(_STATIC / "page.html"))
        add("/head/stop", self._stop, "POST")
        add("/head/resume", self._resume, "POST")
        add("/head/do/{name}", self._do, "POST")
        add("/head/mesh/{number}", lambda number: _mesh(lambda: self._live.meshes[int(number)]))
        add("/head/parameters", self._list_parameters)
        add("/head/recordings", self._list_recordings)
        add("/head/recordings/{name}", self._download)
        add("/head/last-minute.mcap", self._download_last_minute)
        add("/head/replay/open", self._open_recording, "POST")
        add("/head/replay/upload", self._upload, "POST")
        add("/head/replay/{key}/at", self._replayed)
        add("/head/replay/{key}/picture", self._replayed_picture)
        add(
            "/head/replay/{key}/mesh/{number}",
            lambda key, number: _mesh(lambda: self._replays.mesh(key, int(number))),
        )
        app.add_api_websocket_route("/head/live", self._watch)

    async def _stop(self, request: Request) -> Response:
        return await self._answer(request, self._robot.stop_everything, self._stopping)

    async def _resume(self, request: Request) -> Response:
        return await self._answer(request, self._robot.stop.resume, self._stopping)

    async def _do(self, name: str, request: Request) -> Response:
        command = self._commands.by_name.get(name)
        if command is None:
            return Response(f"There is no command {name!r}.", 404)
        body = await _body(request)
        if isinstance(body, Response):
            return body
        return await self._answer(request, lambda: command(body))

    async def _answer(
        self, request: Request, ask: Callable[[], Any], threads: ThreadPoolExecutor | None = None
    ) -> Response:
        """Return what a function in a thread returns: an Outcome, or what JSON can hold."""
        if request.headers.get(_OWN_HEADER) != "page":
            return Response("Only the page itself may send commands.", 403)
        try:
            loop = asyncio.get_running_loop()
            outcome = await loop.run_in_executor(threads or self._working, ask)
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            text = f"{error.args[0]!r} is missing." if isinstance(error, KeyError) else str(error)
            return _json({"done": False, "text": text}, 400)
        return _json(outcome._asdict() if isinstance(outcome, Outcome) else outcome)

    async def _list_parameters(self, request: Request) -> Response:
        return await self._answer(
            request, lambda: {"presets": PRESETS, "parameters": self._tuning.listed()}
        )

    async def _list_recordings(self, request: Request) -> Response:
        def listed() -> list[dict[str, Any]]:
            files = self._robot.recorder.files()
            return [{"name": file.name, "size": file.stat().st_size} for file in files]

        return await self._answer(request, listed)

    def _recording(self, name: str) -> Path:
        """Return one of the listed recordings by its name.

        Raises:
            RecordingError: there is none.
        """
        for file in self._robot.recorder.files():
            if file.name == name:
                return file
        raise RecordingError(f"There is no recording {name!r}.")

    async def _download(self, name: str) -> Response:
        try:
            file = self._recording(name)
        except RecordingError as error:
            return Response(str(error), 404)
        return FileResponse(file, filename=file.name, media_type="application/octet-stream")

    async def _download_last_minute(self) -> Response:
        loop = asyncio.get_running_loop()
        try:
            content = await loop.run_in_executor(self._working, self._replays.last_minute)
        except RecordingError as error:
            return Response(str(error), 404)
        name = time.strftime("head-%Y%m%d-%H%M%S-last-minute.mcap")
        headers = {"Content-Disposition": f'attachment; filename="{name}"'}
        return Response(content, media_type="application/octet-stream", headers=headers)

    async def _open_recording(self, request: Request) -> Response:
        body = await _body(request)
        if isinstance(body, Response):
            return body
        name = str(body.get("name", ""))
        if not name:
            return await self._answer(request, self._replays.open_last_minute)
        return await self._answer(request, lambda: self._replays.open_file(self._recording(name)))

    async def _upload(self, request: Request) -> Response:
        """Open a recording that a browser sends, up to a size that is counted while it comes."""
        if request.headers.get(_OWN_HEADER) != "page":
            return Response("Only the page itself may send recordings.", 403)
        size, loop = 0, asyncio.get_running_loop()
        with tempfile.TemporaryFile() as file:
            async for chunk in request.stream():
                size += len(chunk)
                if size > _LARGEST_RECORDING:
                    text = f"A recording may have {_LARGEST_RECORDING / 1e6:.0f} MB."
                    return _json({"done": False, "text": text}, 413)
                await loop.run_in_executor(self._working, file.write, chunk)
            file.seek(0)
            return await self._answer(request, lambda: self._replays.open_file(file))

    async def _replayed(self, key: str, time: float) -> Response:
        try:
            return Response(self._replays.at(key, time), media_type="application/json")
        except (LookupError, ValueError, OverflowError):
            return Response("The recording is not open any more.", 404)

    async def _replayed_picture(self, key: str, time: float) -> Response:
        try:
            picture = self._replays.picture(key, time)
        except (LookupError, ValueError, OverflowError):
            return Response("The recording is not open any more.", 404)
        if picture is None:
            return Response(status_code=204)
        kind = "image/jpeg" if picture[:2] == b"\xff\xd8" else "image/png"
        return Response(picture, media_type=kind)

    async def _watch(self, browser: WebSocket) -> None:
        """Send states and pictures to a browser. A slow one skips those it has no time for."""
        await browser.accept()
        if len(self._browsers) >= self._limit:
            await browser.close(4008, "too many browsers watch this robot (max_browsers)")
            return
        watcher = self._browsers[browser] = _Watcher()
        sending = asyncio.create_task(self._send(browser, watcher))
        try:
            while True:
                watcher.receive(await browser.receive_text())
        except (WebSocketDisconnect, KeyError, RuntimeError):
            pass
        finally:
            del self._browsers[browser]
            sending.cancel()
            with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await sending

    async def _send(self, browser: WebSocket, watcher: _Watcher) -> None:
        robot, slow, number = "", "", (-1, "")
        while True:
            await self._sampled.wait()
            if robot != self._live.robot_text:
                robot = self._live.robot_text
                await browser.send_text(robot)
            if slow != self._live.slow_text:
                slow = self._live.slow_text
                await browser.send_text(slow)
            await browser.send_text(self._state)
            topic = watcher.topic
            if not watcher.ready or topic is None:
                continue
            picture = self._pictures.get(topic)
            if picture is not None and (picture.number, topic) != number:
                number, watcher.ready = (picture.number, topic), False
                await browser.send_bytes(picture.data)


class _Watcher:
    """What a browser wants to be sent.

    Attributes:
        ready: whether it has shown the last picture.
        topic: of its pictures; empty: the default one; None: no pictures.
    """

    def __init__(self) -> None:
        self.ready = True
        self.topic: str | None = ""

    def receive(self, text: str) -> None:
        """Receive what the browser sends: `got` after each picture, or a topic."""
        if text == "got":
            self.ready = True
        elif text.startswith("camera "):
            self.topic = text.removeprefix("camera ")
        elif text == "blind":
            self.topic = None


def _wheel() -> Path:
    """Return the folder of NiceGUI without importing it, which would take a second."""
    spec = find_spec("nicegui")
    assert spec is not None and spec.submodule_search_locations is not None
    return Path(spec.submodule_search_locations[0])


def _mesh(find: Callable[[], bytes]) -> Response:
    try:
        return Response(find(), media_type="model/stl")
    except (LookupError, ValueError):
        return Response("There is no such mesh.", 404)


async def _body(request: Request) -> dict[str, Any] | Response:
    """Return the JSON object in a request's body, or the response to an invalid body."""
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > _LARGEST_REQUEST:
            return Response(f"A request may have {_LARGEST_REQUEST} bytes.", 413)
    try:
        fields = json.loads(bytes(body) or b"{}")
    except (ValueError, RecursionError):
        fields = None
    if isinstance(fields, dict):
        return fields
    return Response("The body must be a JSON object.", 400)


def _json(content: Any, status: int = 200) -> Response:
    return Response(json.dumps(content), status, media_type="application/json")


def _listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens at an address, on the next free port if the port is taken.

    Raises:
        ParameterError: the address can't be listened on.
    """
    try:
        family, kind, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        for number in range(port, min(port + _PORTS, 65536)) if port else (0,):
            with contextlib.ExitStack() as attempt:
                listening = attempt.enter_context(socket.socket(family, kind))
                listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                try:
                    listening.bind((address[0], number, *address[2:]))
                except OSError as error:
                    if error.errno != errno.EADDRINUSE:
                        raise
                    continue
                listening.listen(128)  # browsers may connect before the server runs
                attempt.pop_all()
                return listening
    except OSError as error:
        raise ParameterError(
            f"The page can't listen on {host!r}, port {port}: {error}. Give 127.0.0.1, 0.0.0.0 or "
            "an address of this machine."
        ) from error
    raise ParameterError(f"The ports {port} to {number} are taken: give another `port`.")
