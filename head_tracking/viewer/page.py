"""The page: one thread that shows the newest state of the robot to all browsers."""

from __future__ import annotations

import contextlib
import io
import itertools
import math
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser

from head_tracking.parameters import ParameterError, parameter
from head_tracking.recording.recording import LastMinute, Observation
from head_tracking.ros.kit.images import frame_pose
from head_tracking.ros.kit.other_services import Outcome
from head_tracking.viewer.badge import Badge, Word
from head_tracking.viewer.camera_picture import CameraPicture, point_in_picture
from head_tracking.viewer.framing import Framing
from head_tracking.viewer.gaze_scene import GazeScene, ViewParameters
from head_tracking.viewer.joints_panel import JointsPanel
from head_tracking.viewer.recording_panel import RecordingPanel
from head_tracking.viewer.robot import Robot
from head_tracking.viewer.robot_scene import FramesScene, RobotScene
from head_tracking.viewer.server import Action, Door, File, Query, guarded, limit_uploads
from head_tracking.viewer.shapes import FindPackage, robot_look
from head_tracking.viewer.status_panel import StatusPanel
from head_tracking.viewer.steering_panel import SteeringPanel
from head_tracking.viewer.tuning_panel import TuningPanel
from head_tracking.viewer.view_panel import ViewPanel

_SLOW = 0.25  # s: text and sliders need no more
_RECORDED = 60.0  # s
_HANGS = 3.0  # s
_AHEAD = 1.5  # m: so far away is what a person points at, and what to look at, if nobody knows
_IN_VIEW = 1.2, 2.3  # m from the camera: room for a target that moves, and a robot of some size
_TO_THE_SIDE, _UP = 0.5, 0.12  # rad: so far from straight ahead
_GRID = (150, 155, 165)


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
        "What a browser on another machine must know to open the page; empty: a new one each "
        "time, which the log tells. Not asked for on 127.0.0.1.",
        fixed=True,
    )
    max_browsers: int = parameter(
        8, "Browsers that may show the page at a time.", minimum=1, maximum=100, fixed=True
    )
    rate: float = parameter(
        25.0, "Pictures per second.", unit="Hz", minimum=1.0, maximum=60.0, fixed=True
    )


class Page:
    """Serves the page from threads of its own until it is closed.

    It only ever looks at the newest state: a slow browser, or none, changes nothing.

    Args:
        robot: shown and steered.
        parameters: where and how often.
        view: what is drawn around the head.
        find_package: for meshes at package:// addresses.
        complain: told of errors of the page itself.

    Raises:
        ValueError: the address can't be listened on.
    """

    def __init__(
        self,
        robot: Robot,
        parameters: PageParameters,
        view: ViewParameters,
        find_package: FindPackage,
        complain: Callable[[str], None],
    ) -> None:
        self._robot = robot
        self._period = 1.0 / parameters.rate
        self._view = view
        self._find_package = find_package
        self._complain = complain
        self._live = Observation(0)
        self._stepped = time.monotonic()
        actions: dict[str, Action] = {
            "/head/status": self._status_now,
            "/head/stop": self._stop,
            "/head/resume": lambda _: {"text": robot.stop.resume().text},
            "/head/picture": self._picture_now,
            "/head/look": self._look_there,
        }
        door = Door(parameters.host, parameters.token, parameters.max_browsers, actions)
        with guarded(door):
            self._server = _serve(parameters.host, parameters.port)
        if not door.stands:
            self._server.stop()
            raise ValueError(
                "with this version of viser any web page that is open here could steer the robot; "
                "install one of the versions in requirements/viewer.txt"
            )
        self._door = door
        limit_uploads(self._server, self._refuse_upload)
        self._scene: RobotScene | None = None
        self._gaze: GazeScene | None = None
        self._frames: FramesScene | None = None
        self._framing = Framing(self._server)
        self._head: Any = None
        self._look_notices: tuple[str, ...] = ()
        self._failing: dict[str, str] = {}
        self._last_minute = LastMinute(_RECORDED)
        self._make_panels()
        self._next_slow = 0.0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The port that the page is at."""
        return int(self._server.get_port())

    @property
    def token(self) -> str:
        """What a browser on another machine must know; empty: nothing."""
        return self._door.token

    @property
    def browsers(self) -> int:
        """How many browsers show the page now."""
        return len(self._server.get_clients())

    def close(self) -> None:
        """Ends the page; the robot goes on as it is."""
        self._ended.set()
        self._thread.join()
        with contextlib.redirect_stdout(io.StringIO()):  # viser says goodbye
            self._server.stop()

    def _make_panels(self) -> None:
        server, robot = self._server, self._robot
        self._status = StatusPanel(server, robot)
        tabs = server.gui.add_tab_group()
        with tabs.add_tab("Steer"):
            self._steering = SteeringPanel(server, robot.modes, robot.buffer)
            self._picture = CameraPicture(server.gui, robot.topics, robot.modes, robot.hold)
            self._status.add_strip()
        with tabs.add_tab("Joints"):
            self._joints = JointsPanel(server, robot.joints)
        with tabs.add_tab("Tune"):
            self._status.add_strip()
            self._tuning = TuningPanel(server, robot.parameters)
        with tabs.add_tab("Health"):
            self._status.add_details()
        with tabs.add_tab("View"):
            self._views = ViewPanel(server, robot, self._view)
        with tabs.add_tab("Record"):
            self._recording = RecordingPanel(
                server, self._last_minute, robot.recorder, robot.hold, robot.model
            )
        self._picture.replay = self._recording

    def _run(self) -> None:
        pause = self._period
        while not self._ended.wait(pause):
            start = time.monotonic()
            try:
                self._step()
            except Exception as error:
                # the page must outlive whatever goes wrong on it
                self._complain(f"{type(error).__name__}: {error}")
                self._ended.wait(1.0)
            taken = time.monotonic() - start
            # what is drawn must also be sent: this thread takes no more than four fifths
            pause = max(self._period - taken, 0.25 * taken)

    def _draw(self, part: str, draw: Callable[[], object]) -> None:
        """Draw a part of the page. One that fails is reported; the others go on."""
        try:
            draw()
            self._failing.pop(part, None)
        except Exception as error:
            text = f"{part} can't be shown: {type(error).__name__}: {error}"
            if self._failing.get(part) != text:
                self._failing[part] = text
                self._complain(text)

    def _step(self) -> None:
        self._draw("the model", self._follow_model)
        live = self._live = self._robot.observe()
        self._stepped = time.monotonic()
        if self._scene is not None:
            self._last_minute.add(live)
        if not self.browsers:
            return
        self._draw("the plots", lambda: self._status.take(live))
        replayed = self._recording.replayed()
        with self._server.atomic():
            self._show(replayed or live)
        self._server.flush()  # now: viser would wait, perhaps until the next one is half drawn
        now = time.monotonic()
        if now >= self._next_slow:
            self._next_slow = now + _SLOW
            self._show_slowly(live, replayed)

    def _show(self, shown: Observation) -> None:
        scene, gaze, frames = self._scene, self._gaze, self._frames
        if scene is None or gaze is None or frames is None:
            return
        draw = self._draw
        draw("the robot", lambda: scene.show(shown.joints))
        draw("the target", lambda: gaze.show(shown.stamp, shown.target, shown.target_stamp))
        draw("the frames", lambda: frames.show(shown.frames))
        draw("the handles of the target", lambda: self._steering.show(shown))
        draw("the camera's view", lambda: self._views.show(shown))
        draw("the camera's picture", lambda: self._picture.show(gaze))
        draw("the first view", lambda: self._framing.show(self._in_view(scene, shown)))

    def _in_view(self, scene: RobotScene, shown: Observation) -> Any:
        """What a person wants to see at first, shape (N, 3) [m]: robot, view cone and target."""
        head, model = self._head, scene.model
        if head is None:
            return scene.corners
        standing = dict.fromkeys(model.independent_joints, 0.0)
        camera = np.array(model.transform(model.root, head.pointing_frame, standing).translation)
        away = _AHEAD if shown.target is None else math.dist(shown.target, camera)
        nearest, farthest = _IN_VIEW
        around = min(max(away, nearest), farthest) * np.array(
            [
                (math.cos(turn), math.sin(turn), up)
                for turn, up in itertools.product((-_TO_THE_SIDE, _TO_THE_SIDE), (-_UP, _UP))
            ]
        )
        return np.concatenate([scene.corners, camera + around])

    def _show_slowly(self, live: Observation, replayed: Observation | None) -> None:
        notices = [*self._failing.values(), *self._look_notices, *self._robot.notices()]
        if self._scene is None:
            notices.append("waiting for robot_description")
        elif unknown := self._scene.unknown_joints():
            notices.append(f"shown at 0, because nobody tells where they are: {', '.join(unknown)}")
        if replayed is not None:
            notices.append("a recording is shown; the robot may be doing something else")
        self._draw("the state", lambda: self._status.refresh(live, notices, replayed))
        self._draw("Steer", self._steering.refresh)
        self._draw("Joints", lambda: self._joints.refresh(live))
        self._draw("Tune", self._tuning.refresh)
        self._draw("View", self._views.refresh)
        self._draw("the menu of pictures", self._picture.refresh)
        self._draw("Record", self._recording.refresh)

    def _stop(self, _: Query) -> dict[str, Any]:
        outcome = self._robot.stop_everything()
        self._recording.close()  # whoever stops the robot wants to see it
        return {"text": outcome.text}

    def _status_now(self, query: Query) -> dict[str, Any]:
        """What is shown above the page."""
        if "looks" in query:
            self._picture.look()
        stop, model = self._robot.stop, self._robot.model()
        now = self._robot.badge(self._live)
        if time.monotonic() - self._stepped > _HANGS:
            now = Badge(Word.FAULT, "the page hangs, and shows what was; STOP still works")
        elif self._recording.replayed() is not None:
            now = Badge(
                Word.REPLAY, f"a recording is shown in every browser; the robot: {now.word}"
            )
        outcome = stop.outcome
        return {
            "word": str(now.word),
            "text": now.text,
            "stop": "" if outcome is None else outcome.text,
            "can_resume": stop.can_resume,
            "title": "head_tracking" if model is None else model.name,
            "picture": self._picture.chosen,
            "legend": self._legend(),
        }

    def _legend(self) -> tuple[tuple[str, str], ...]:
        """What the colours of the scene mean, each with the colour."""
        drawn = () if self._gaze is None else self._gaze.legend()
        return (*drawn, *self._steering.path.legend())

    def _picture_now(self, query: Query) -> File:
        """What the camera sees, if that is another picture than the one that a browser has."""
        took = 1e-3 * max(0, _whole(query.get("took", "")))
        jpeg = self._picture.jpeg(_whole(query.get("after", "")), took)
        if jpeg is None:
            return File("image/jpeg", b"")
        told = {"X-Number": str(jpeg.number), "X-Stamp": str(jpeg.stamp)}
        return File("image/jpeg", jpeg.data, told)

    def _look_there(self, query: Query) -> dict[str, Any]:
        """Looks where a person points in the camera's picture."""
        model, picture = self._robot.model(), self._picture.newest()
        if model is None or picture is None:
            return Outcome(False, "there is no picture now")._asdict()
        try:
            share = float(query["u"]), float(query["v"])
            stamp = int(query["stamp"])
        except (KeyError, ValueError):
            return Outcome(False, "u, v and stamp say where in which picture")._asdict()
        camera = frame_pose(self._robot.buffer, model.root, picture.frame_id, stamp)
        if camera is None:
            return Outcome(
                False, f"the picture is of the frame {picture.frame_id!r}: where is that?"
            )._asdict()
        target = self._live.target
        distance = _AHEAD if target is None else math.dist(camera.translation, target)
        point = point_in_picture(picture, share, camera, distance, self._view.horizontal_view)
        return self._robot.modes.look_at(model.root, point)._asdict()

    def _refuse_upload(self, number: int, text: str) -> None:
        client = self._server.get_clients().get(number)
        if client is not None:
            client.add_notification("Recording: refused", text, color="red")

    def _follow_model(self) -> None:
        live = self._robot.model()
        model = self._recording.model or live
        if model is not None and (self._scene is None or self._scene.model is not model):
            if self._scene is not None and self._frames is not None and self._gaze is not None:
                self._frames.remove()
                self._gaze.remove()
                self._scene.remove()
            look = robot_look(model.urdf, self._find_package)
            self._look_notices = look.notices
            self._scene = RobotScene(self._server.scene, model, look)
            self._gaze = GazeScene(self._server.scene, self._scene, self._view)
            self._frames = FramesScene(self._server.scene, self._scene)
            self._head = None
            self._server.gui.set_panel_label(model.name)
            if model is live:
                self._joints.set_model(model)
                self._steering.set_root(model.root)
            self._views.set_scenes(self._gaze, self._frames)
        head = self._robot.head() if model is live else None
        if head is not None and head is not self._head and self._gaze and self._scene:
            self._head = head
            self._gaze.set_head(head)
            self._views.set_head(self._scene.model, head)
            self._steering.path.set_head(self._scene.model, head)
            self._framing.show_first(self._in_view(self._scene, self._live))


def _whole(text: str) -> int:
    """A whole number; -1 for anything else."""
    return int(text) if text.isdecimal() else -1


def _check_address(host: str) -> None:
    """Refuses an address that viser would wait for without end."""
    try:
        family, kind, *_, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as attempt:
            attempt.bind(address)
    except OSError as error:
        raise ParameterError(
            f"the page can't listen on {host!r}: {error}; give 127.0.0.1, 0.0.0.0 or an address of "
            "this machine"
        ) from error


def _serve(host: str, port: int) -> viser.ViserServer:
    _check_address(host)
    with contextlib.redirect_stdout(io.StringIO()):  # viser greets
        server = viser.ViserServer(host=host, port=port, label="head_tracking", verbose=False)
    server.gui.configure_theme(
        show_logo=False, show_share_button=False, control_width="large", brand_color=(40, 110, 180)
    )
    server.gui.main_panel.dock_right()
    # any page could ask for a tunnel through which the whole world steers the robot
    server.request_share_url = lambda verbose=True: None
    server.scene.configure_default_lights(cast_shadow=False)  # too much without a graphics card
    server.scene.add_grid(
        "/floor", 6.0, 6.0, cell_size=0.25, section_size=1.0, cell_color=_GRID,
        section_color=_GRID, cell_thickness=0.4, section_thickness=0.7,
        fade_distance=8.0, fade_strength=1.5, fade_from="origin",
    )  # fmt: skip
    return server
