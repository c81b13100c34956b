"""The server of the page: STOP, commands, live states and pictures, on one event loop."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import math
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
from head_tracking.page.gaze_lines import path_ahead
from head_tracking.page.head_modes import CAMERA, Mode
from head_tracking.page.live import Live, ViewParameters
from head_tracking.page.path import Path as TargetPath
from head_tracking.page.replay import Replays
from head_tracking.page.robot import Robot
from head_tracking.page.shapes import FindPackage
from head_tracking.page.tuning import PRESETS, Tuning
from head_tracking.parameters import ParameterError, parameter
from head_tracking.recording.recording import RecordingError
from head_tracking.ros.kit.other_services import Outcome

_STATIC = Path(__file__).with_name("static")
_MARK = "x-head-tracking"
"""A header that pages of other sites can't send without being asked first (CORS)."""

_LARGEST_REQUEST = 64 * 1024  # bytes
_LARGEST_RECORDING = 256 * 1024 * 1024  # bytes that may be uploaded
_START, _END = 10.0, 2.0  # s
_PORTS = 20  # that are tried
_UNWATCHED = 0.2  # s between samples while no browser watches

Command = Callable[[dict[str, Any]], Outcome]


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

    Commands to the robot run in threads beside the event loop; STOP has threads that nothing else
    uses. NiceGUI's wheel brings FastAPI, three.js and the fonts; nothing else of it is used.

    Args:
        robot: shown and steered.
        parameters: where and how often.
        view: what is drawn around the head.
        find_package: for meshes at package:// addresses.
        report: receives a sentence when a part of the page begins to fail.

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
        self._browsers: set[WebSocket] = set()
        self._state, self._sampled = "", asyncio.Event()
        self._stopping = ThreadPoolExecutor(4, "stop")
        self._working = ThreadPoolExecutor(8, "command")
        self._commands: dict[str, Command] = {
            "mode": self._set_mode,
            "look": self._look,
            "path": self._set_path,
            "aim": self._aim,
            "centre": lambda _: robot.modes.centre(),
            "camera": lambda _: robot.modes.start(CAMERA),
            "torque": self._set_torque,
            "recover": lambda _: robot.joints.recover(),
            "set": lambda said: self._tuning.set(
                str(said["node"]), str(said["name"]), said["value"]
            ),
            "reset": lambda _: self._tuning.reset(),
            "preset": lambda said: self._tuning.choose(str(said["name"])),
            "record": self._record,
            "calibrate": lambda said: self._live.calibration.begin(
                float(said["size"]), str(said.get("topic", ""))
            ),
        }
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
        """The port that the page is at."""
        return int(self._socket.getsockname()[1])

    @property
    def token(self) -> str:
        """What a browser on another machine must present; empty: nothing."""
        return self._access.token

    @property
    def browsers(self) -> int:
        """How many browsers watch now."""
        return len(self._browsers)

    def close(self) -> None:
        """End the page; the robot goes on as it is."""
        self._server.should_exit = True
        self._thread.join(_START + _END)
        self._stopping.shutdown(wait=False, cancel_futures=True)
        self._working.shutdown(wait=False, cancel_futures=True)

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
        """Sample the robot for all browsers; rarely while there are none."""
        while True:
            start = time.monotonic()
            if self._browsers:
                self._state = self._live.sample()
                self._sampled.set()
                self._sampled = asyncio.Event()
            else:
                self._live.observe()
            taken = time.monotonic() - start
            period = self._period if self._browsers else _UNWATCHED
            # STOP shares this loop: sampling takes no more than half of its time
            await asyncio.sleep(max(period - taken, taken))

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
        return await self._answer(request, self._stopping, self._robot.stop_everything)

    async def _resume(self, request: Request) -> Response:
        return await self._answer(request, self._stopping, self._robot.stop.resume)

    async def _do(self, name: str, request: Request) -> Response:
        command = self._commands.get(name)
        if command is None:
            return Response(f"There is no command {name!r}.", 404)
        said = await _body(request)
        if isinstance(said, Response):
            return said
        return await self._answer(request, self._working, lambda: command(said))

    async def _answer(
        self, request: Request, threads: ThreadPoolExecutor, ask: Callable[[], Any]
    ) -> Response:
        """Return what a function in a thread answers: an Outcome, or what JSON can hold."""
        if request.headers.get(_MARK) != "page":
            return Response("Only the page itself may send commands.", 403)
        try:
            outcome = await asyncio.get_running_loop().run_in_executor(threads, ask)
        except (LookupError, TypeError, ValueError) as error:
            text = f"{error.args[0]!r} is missing." if isinstance(error, KeyError) else str(error)
            return _json({"done": False, "text": text}, 400)
        return _json(outcome._asdict() if isinstance(outcome, Outcome) else outcome)

    async def _list_parameters(self, request: Request) -> Response:
        return await self._answer(
            request,
            self._working,
            lambda: {"presets": PRESETS, "parameters": self._tuning.listed()},
        )

    async def _list_recordings(self, request: Request) -> Response:
        def listed() -> list[dict[str, Any]]:
            return [
                {"name": file.name, "size": file.stat().st_size}
                for file in self._robot.recorder.files()
            ]

        return await self._answer(request, self._working, listed)

    def _recording(self, name: str) -> Path | None:
        """Return a recording by its name: one of those that are listed, and no other file."""
        return next((file for file in self._robot.recorder.files() if file.name == name), None)

    async def _download(self, name: str) -> Response:
        file = self._recording(name)
        if file is None:
            return Response(f"There is no recording {name!r}.", 404)
        return FileResponse(file, filename=file.name, media_type="application/octet-stream")

    async def _download_last_minute(self) -> Response:
        loop = asyncio.get_running_loop()
        try:
            content = await loop.run_in_executor(self._working, self._replays.last_minute)
        except RecordingError as error:
            return Response(str(error), 404)
        name = time.strftime("head-%Y%m%d-%H%M%S-last-minute.mcap")
        return Response(
            content,
            media_type="application/octet-stream",
            headers={"Content-Disposition": f'attachment; filename="{name}"'},
        )

    async def _open_recording(self, request: Request) -> Response:
        said = await _body(request)
        if isinstance(said, Response):
            return said

        def opened() -> dict[str, Any]:
            name = str(said.get("name", ""))
            if not name:
                return self._replays.open_last_minute()
            file = self._recording(name)
            if file is None:
                raise RecordingError(f"There is no recording {name!r}.")
            return self._replays.open_file(file)

        return await self._answer(request, self._working, opened)

    async def _upload(self, request: Request) -> Response:
        """Open a recording that a browser sends; what counts is the size that really comes."""
        if request.headers.get(_MARK) != "page":
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
            return await self._answer(request, self._working, lambda: self._replays.open_file(file))

    async def _replayed(self, key: str, time: float) -> Response:
        try:
            state = self._replays.at(key, time)
        except (LookupError, ValueError, OverflowError):
            return Response("The recording is not open any more.", 404)
        return Response(state, media_type="application/json")

    async def _replayed_picture(self, key: str, time: float) -> Response:
        try:
            picture = self._replays.picture(key, time)
        except (LookupError, ValueError, OverflowError):
            return Response("The recording is not open any more.", 404)
        if picture is None:
            return Response(status_code=204)
        return Response(
            picture, media_type="image/jpeg" if picture[:2] == b"\xff\xd8" else "image/png"
        )

    async def _watch(self, browser: WebSocket) -> None:
        """Send states and pictures to a browser. One that is slow skips what it has no time for."""
        await browser.accept()
        if len(self._browsers) >= self._limit:
            await browser.close(4008, "too many browsers watch this robot (max_browsers)")
            return
        self._browsers.add(browser)
        watcher = _Watcher()
        sending = asyncio.create_task(self._send(browser, watcher))
        try:
            while True:
                watcher.receive(await browser.receive_text())
        except (WebSocketDisconnect, KeyError, RuntimeError):
            pass
        finally:
            self._browsers.discard(browser)
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
            picture = self._live.picture(topic)
            if picture is not None and (picture.number, topic) != number:
                number, watcher.ready = (picture.number, topic), False
                await browser.send_bytes(picture.data)

    def _set_mode(self, said: dict[str, Any]) -> Outcome:
        return self._robot.modes.set_mode(Mode(str(said["mode"])), str(said.get("frame", "")))

    def _look(self, said: dict[str, Any]) -> Outcome:
        model, modes = self._robot.model(), self._robot.modes
        if model is None:
            return Outcome(False, "No robot description has been received.")
        if "point" in said:
            x, y, z = map(float, said["point"])
            frame = str(said.get("frame") or model.root)
        else:
            stamp = said.get("stamp")
            x, y, z = self._live.point_at(
                _share(said["u"]),
                _share(said["v"]),
                None if stamp is None else int(stamp),
                str(said.get("topic", "")),
            )
            frame = model.root
        if said.get("take_over") and modes.mode() is Mode.OFF:
            mode = Mode.TRACK if Mode.TRACK in modes.possible() else Mode.POINT
            outcome = modes.set_mode(mode)
            if not outcome.done:
                return outcome
        return modes.look_at(frame, (x, y, z), wait=said.get("wait") is True)

    def _set_path(self, said: dict[str, Any]) -> Outcome:
        """Look along a shape before the camera, or along points in the model's root."""
        speed, modes = _positive(said, "speed"), self._robot.modes
        if "points" in said:
            points = [(float(x), float(y), float(z)) for x, y, z in said["points"]]
            if not all(math.isfinite(value) for point in points for value in point):
                raise ValueError("The points must be finite numbers in metres.")
            path = TargetPath(points)
        else:
            model, head = self._robot.model(), self._robot.head()
            if model is None or head is None:
                return Outcome(False, "No head is known to make a path before.")
            path = path_ahead(model, head, str(said["shape"]), _positive(said, "size"))
        modes.set_path(path, speed)
        return modes.set_mode(Mode.PATH)

    def _aim(self, said: dict[str, Any]) -> Outcome:
        positions = {str(name): float(value) for name, value in dict(said["joints"]).items()}
        if not all(map(math.isfinite, positions.values())):
            raise ValueError("Joint positions must be finite numbers in rad or m.")
        return self._robot.joints.move(positions)

    def _set_torque(self, said: dict[str, Any]) -> Outcome:
        return self._robot.joints.set_torque(str(said.get("controller", "")), said["on"] is True)

    def _record(self, said: dict[str, Any]) -> Outcome:
        recorder = self._robot.recorder
        return recorder.start() if said["on"] is True else recorder.stop()


class _Watcher:
    """What a browser wants to be sent.

    Attributes:
        ready: whether it has shown the picture before.
        topic: whose pictures it wants; empty: the default ones; None: none.
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
    """Return the folder of NiceGUI, which is not imported: that would take a second."""
    spec = find_spec("nicegui")
    assert spec is not None and spec.submodule_search_locations is not None
    return Path(spec.submodule_search_locations[0])


def _mesh(find: Callable[[], bytes]) -> Response:
    try:
        return Response(find(), media_type="model/stl")
    except (LookupError, ValueError):
        return Response("There is no such mesh.", 404)


async def _body(request: Request) -> dict[str, Any] | Response:
    """Return the JSON object in a request's body, or the answer to a body that is none."""
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > _LARGEST_REQUEST:
            return Response(f"A request may have {_LARGEST_REQUEST} bytes.", 413)
    try:
        said = json.loads(bytes(body) or b"{}")
    except ValueError:
        said = None
    return said if isinstance(said, dict) else Response("The body must be a JSON object.", 400)


def _share(value: Any) -> float:
    """Return a share of a picture's width or height.

    Raises:
        ValueError: it is not a number from 0 to 1.
    """
    share = float(value)
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"u and v must be from 0 to 1, not {value!r}.")
    return share


def _positive(said: dict[str, Any], name: str) -> float:
    """Return a positive number, up to 10.

    Raises:
        ValueError: it is something else.
    """
    value = float(said[name])
    if not 0.0 < value <= 10.0:
        raise ValueError(f"{name} must be above 0 and up to 10, not {value}.")
    return value


def _json(what: Any, status: int = 200) -> Response:
    return Response(json.dumps(what), status, media_type="application/json")


def _listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens at an address; at the next free port where the port is taken.

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
                listening.listen(128)  # browsers that come before the server runs wait for it
                attempt.pop_all()
                return listening
    except OSError as error:
        raise ParameterError(
            f"The page can't listen on {host!r}, port {port}: {error}. Give 127.0.0.1, 0.0.0.0 or "
            "an address of this machine."
        ) from error
    raise ParameterError(f"The ports {port} to {number} are taken: give another `port`.")
