"""The server of the page: STOP, commands, live states and pictures, on one event loop."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import socket
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import uvicorn
from fastapi import FastAPI, Request, Response, WebSocket, WebSocketDisconnect
from fastapi.staticfiles import StaticFiles
from nicegui import ui
from nicegui.elements import scene as _scene  # noqa: F401, registers three.js as nicegui-scene

from head_tracking.ros.other_services import Outcome
from head_tracking.viewer.robot import Robot
from head_tracking.viewer.shapes import FindPackage

from .access import Access
from .live import Live, mode_named

_STATIC = Path(__file__).with_name("static")
_MARK = "x-head-tracking"
"""A header that pages of other sites can't send without being asked first (CORS)."""

_LARGEST_REQUEST = 64 * 1024  # bytes
_START, _END = 10.0, 2.0  # s

Command = Callable[[dict[str, Any]], Outcome]


class Page:
    """Serves the page from a thread of its own until it is closed.

    Commands to the robot run in threads beside the event loop; STOP has threads that nothing else
    uses. NiceGUI keeps its state in one place for a process: one page in a process.

    Args:
        robot: shown and steered.
        host: address to listen on.
        port: port to listen on; 0: any.
        token: what a browser on another machine must present; empty: a random one.
        max_browsers: how many browsers may watch at a time.
        rate: states per second [Hz].
        horizontal_view: of a camera without calibration [rad].
        find_package: for meshes at package:// addresses.

    Raises:
        ValueError: the address can't be listened on.
    """

    def __init__(
        self,
        robot: Robot,
        find_package: FindPackage,
        *,
        host: str = "127.0.0.1",
        port: int = 8080,
        token: str = "",
        max_browsers: int = 8,
        rate: float = 25.0,
        horizontal_view: float = 1.0,
    ) -> None:
        self._robot = robot
        self._live = Live(robot, find_package, horizontal_view)
        self._limit, self._period = max_browsers, 1.0 / rate
        self._browsers: set[WebSocket] = set()
        self._state, self._sampled = "", asyncio.Event()
        self._stopping = ThreadPoolExecutor(4, "stop")
        self._working = ThreadPoolExecutor(8, "command")
        self._commands: dict[str, Command] = {
            "mode": self._set_mode,
            "look": self._look,
            "aim": self._aim,
            "centre": lambda _: robot.modes.centre(),
            "torque": self._set_torque,
            "recover": lambda _: robot.joints.recover(),
        }
        self._socket = _listening(host, port)
        app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
        self._add_routes(app)
        self._access = Access(app, host, token)
        self._server = uvicorn.Server(
            uvicorn.Config(
                self._access,
                log_level="critical",
                access_log=False,
                ws_max_size=_LARGEST_REQUEST,
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
        """Sample the robot for all browsers, while there are any."""
        while True:
            if self._browsers:
                self._state = self._live.sample()
                self._sampled.set()
                self._sampled = asyncio.Event()
            await asyncio.sleep(self._period if self._browsers else 0.1)

    def _add_routes(self, app: FastAPI) -> None:
        app.mount("/head/static", StaticFiles(directory=_STATIC), name="parts")
        app.add_api_route("/head/stop", self._stop, methods=["POST"], response_model=None)
        app.add_api_route("/head/resume", self._resume, methods=["POST"], response_model=None)
        app.add_api_route("/head/do/{name}", self._do, methods=["POST"], response_model=None)
        app.add_api_route("/head/mesh/{number}", self._mesh, response_model=None)
        app.add_api_websocket_route("/head/live", self._watch)

        @ui.page("/", title="head_tracking", dark=None)
        def _page() -> None:
            ui.add_head_html('<link rel="stylesheet" href="/head/static/page.css">')
            ui.add_head_html('<script type="module" src="/head/static/page.js"></script>')
            ui.html((_STATIC / "page.html").read_text(), sanitize=False).classes("head-page")

        ui.run_with(app, binding_refresh_interval=None, tailwind=False, show_welcome_message=False)

    async def _stop(self, request: Request) -> Response:
        return await self._answer(request, self._stopping, self._robot.stop_everything)

    async def _resume(self, request: Request) -> Response:
        return await self._answer(request, self._stopping, self._robot.stop.resume)

    async def _do(self, name: str, request: Request) -> Response:
        command = self._commands.get(name)
        if command is None:
            return Response(f"There is no command {name!r}.", 404)
        body = bytearray()
        async for chunk in request.stream():
            body += chunk
            if len(body) > _LARGEST_REQUEST:
                return Response(f"A request may have {_LARGEST_REQUEST} bytes.", 413)
        try:
            said = json.loads(bytes(body) or b"{}")
        except ValueError:
            said = None
        if not isinstance(said, dict):
            return Response("The body must be a JSON object.", 400)
        return await self._answer(request, self._working, lambda: command(said))

    async def _answer(
        self, request: Request, threads: ThreadPoolExecutor, ask: Callable[[], Outcome]
    ) -> Response:
        if request.headers.get(_MARK) != "page":
            return Response("Only the page itself may send commands.", 403)
        try:
            outcome = await asyncio.get_running_loop().run_in_executor(threads, ask)
        except (KeyError, TypeError, ValueError) as error:
            return _json({"done": False, "text": str(error)}, 400)
        return _json(outcome._asdict())

    async def _mesh(self, number: int) -> Response:
        meshes = self._live.meshes
        if not 0 <= number < len(meshes):
            return Response(f"There is no mesh {number}.", 404)
        return Response(meshes[number], media_type="model/stl")

    async def _watch(self, browser: WebSocket) -> None:
        """Send states and pictures to a browser. One that is slow skips what it has no time for."""
        await browser.accept()
        if len(self._browsers) >= self._limit:
            await browser.close(1013, "too many browsers watch this robot (max_browsers)")
            return
        self._browsers.add(browser)
        ready = asyncio.Event()
        ready.set()
        sending = asyncio.create_task(self._send(browser, ready))
        try:
            while True:
                if await browser.receive_text() == "got":
                    ready.set()
        except (WebSocketDisconnect, KeyError, RuntimeError):
            pass
        finally:
            self._browsers.discard(browser)
            sending.cancel()
            with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await sending

    async def _send(self, browser: WebSocket, ready: asyncio.Event) -> None:
        """Send to a browser; `ready` says that it has shown the picture before."""
        robot, number = "", -1
        while True:
            await self._sampled.wait()
            if robot != self._live.robot_text:
                robot = self._live.robot_text
                await browser.send_text(robot)
            await browser.send_text(self._state)
            picture = self._live.picture() if ready.is_set() else None
            if picture is not None and picture.number != number:
                number = picture.number
                ready.clear()
                await browser.send_bytes(picture.data)

    def _set_mode(self, said: dict[str, Any]) -> Outcome:
        return self._robot.modes.set_mode(mode_named(str(said["mode"])), str(said.get("frame", "")))

    def _look(self, said: dict[str, Any]) -> Outcome:
        model = self._robot.model()
        if model is None:
            return Outcome(False, "No robot description has been received.")
        if "point" in said:
            x, y, z = map(float, said["point"])
            return self._robot.modes.look_at(str(said.get("frame", model.root)), (x, y, z))
        stamp = said.get("stamp")
        point = self._live.point_at(
            _share(said["u"]), _share(said["v"]), None if stamp is None else int(stamp)
        )
        return self._robot.modes.look_at(model.root, point)

    def _aim(self, said: dict[str, Any]) -> Outcome:
        positions = {str(name): float(value) for name, value in dict(said["joints"]).items()}
        if not all(map(math.isfinite, positions.values())):
            raise ValueError("Joint positions must be finite numbers in rad or m.")
        return self._robot.joints.move(positions)

    def _set_torque(self, said: dict[str, Any]) -> Outcome:
        return self._robot.joints.set_torque(str(said.get("controller", "")), said["on"] is True)


def _share(value: Any) -> float:
    """Return a share of a picture's width or height.

    Raises:
        ValueError: it is not a number from 0 to 1.
    """
    share = float(value)
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"u and v must be from 0 to 1, not {value!r}.")
    return share


def _json(what: dict[str, Any], status: int = 200) -> Response:
    return Response(json.dumps(what), status, media_type="application/json")


def _listening(host: str, port: int) -> socket.socket:
    """Return a socket that is bound to an address.

    Raises:
        ValueError: the address can't be listened on.
    """
    try:
        family, kind, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.socket(family, kind)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
    except OSError as error:
        raise ValueError(
            f"The page can't listen on {host!r}, port {port}: {error}. Give 127.0.0.1, 0.0.0.0 or "
            "an address of this machine, and a free port."
        ) from error
    return listening
