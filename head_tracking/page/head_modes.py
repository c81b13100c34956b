"""Modes of a head: which controller turns it, and which node sends the targets."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from itertools import repeat
from typing import TYPE_CHECKING, Any, NamedTuple

from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from head_tracking.compatibility import StrEnum
from head_tracking.exceptions import HeadTrackingError
from head_tracking.page.path import ClosedPath
from head_tracking.ros.kit.spinning import steady_timer
from head_tracking.ros.kit.target_point import target_message
from head_tracking.targets import FrameTarget, FrameTargetParameters, StaleFrameError
from head_tracking.tracking import Target
from head_tracking.transforms import TransformException, Vector3

if TYPE_CHECKING:
    from head_tracking.page.robot import Robot

TRACKER, POINTER = "head_tracker", "point_head"
FICTITIOUS, VISUAL, MUX = "fictitious_target", "visual_target", "target_mux"
CAMERA = "simulated_camera"
CONTROLLERS = (TRACKER, POINTER)
SENDERS = (FICTITIOUS, VISUAL, MUX, "frame_target", "detection_target")
NODES = (*SENDERS, *CONTROLLERS)

_SEND_PERIOD = 0.05  # s
_PATIENCE = 10.0  # s
_BUSY = 1.0  # s that a target waits for a change of the mode
_POLL = 0.02  # s


class Mode(StrEnum):
    """What the head looks at."""

    OFF = "nothing"
    POINT = "point"
    TRACK = "track"
    FACE = "face"
    BALL = "ball"
    MARKER = "marker"
    VISUAL = "what the camera finds"
    FOLLOW = "follow a frame"
    PATH = "path"
    FICTITIOUS = "fictitious target"
    MUX = "target_mux"


_NODES: Mapping[Mode, tuple[str, ...]] = {
    Mode.OFF: (),
    Mode.POINT: (POINTER,),
    Mode.TRACK: (TRACKER,),
    Mode.FACE: (TRACKER, VISUAL),
    Mode.BALL: (TRACKER, VISUAL),
    Mode.MARKER: (TRACKER, VISUAL),
    Mode.VISUAL: (TRACKER, VISUAL),
    Mode.FOLLOW: (TRACKER,),
    Mode.PATH: (TRACKER,),
    Mode.FICTITIOUS: (TRACKER, FICTITIOUS),
    Mode.MUX: (TRACKER, MUX),
}
"""The controller, and the node that sends targets if the page does not."""

_FOLLOWS: Mapping[Mode, str] = {Mode.FACE: "face", Mode.BALL: "colour", Mode.MARKER: "marker"}
"""The parameter `follow` of `visual_target`."""

FOUND_IN_PICTURES = (*_FOLLOWS, Mode.VISUAL)
"""Modes in which `visual_target` sends the targets."""


def _refuse_if(reason: str) -> None:
    if reason:
        raise HeadTrackingError(reason)


class _Sending(NamedTuple):
    """Targets that the page publishes.

    Attributes:
        mode: what they are sent for; for POINT only once.
        targets: the next ones; None: none is sent now.
        stops: number of STOPs when that began; another one ends it.
    """

    mode: Mode
    targets: Iterator[Target | None]
    stops: int


class HeadModes:
    """Enables and disables the nodes of a head, and sends targets; for any thread.

    A request that is not carried out raises HeadTrackingError. A node is enabled if its topic
    `~/enabled` says so; the page keeps no state but its targets. A STOP ends what the page sends
    and enables.
    """

    def __init__(self, node: Node, robot: Robot) -> None:
        self._node, self._poll = node, robot.poll
        self._services, self._topics, self._graph = robot.services, robot.topics, robot.graph
        self._parameters, self._buffer, self._stop = robot.parameters, robot.buffer, robot.stop
        self._changing = threading.Lock()
        self._wanted: tuple[Mode, str] = Mode.OFF, ""
        self._services.know(SetBool, *(f"{name}/enable" for name in NODES))
        self._services.know(Trigger, *(f"{name}/recenter" for name in CONTROLLERS))
        startable = (*CONTROLLERS, FICTITIOUS, VISUAL)
        self._services.know(Trigger, *(f"node_starter/{name}" for name in startable))
        self._targets = node.create_publisher(PointStamped, "target_point", 10)
        self._selections = node.create_publisher(PointStamped, f"{VISUAL}/select_point", 10)
        self._sending: _Sending | None = None
        self._send_lock = threading.Lock()
        self._timer = steady_timer(node, _SEND_PERIOD, self._send_next)
        self._timer.cancel()

    def mode(self) -> Mode:
        """Return the mode by the nodes that are enabled; during a STOP that which goes on then."""
        goes_on = self._stop.stopped and any(map(self._is_enabled, SENDERS))
        if goes_on or self._is_enabled(TRACKER):
            if self._is_enabled(VISUAL):
                follow = self.value(VISUAL, "follow")
                return next((mode for mode, one in _FOLLOWS.items() if one == follow), Mode.VISUAL)
            for mode in (Mode.FICTITIOUS, Mode.MUX):
                if self._is_enabled(_NODES[mode][1]):
                    return mode
            sending = self._sending
            return Mode.TRACK if sending is None else sending.mode
        return Mode.POINT if self._is_enabled(POINTER) else Mode.OFF

    def possible(self) -> tuple[Mode, ...]:
        """Return the modes whose nodes exist or can be started."""
        return tuple(
            mode
            for mode, nodes in _NODES.items()
            if mode is not Mode.VISUAL  # only another program chooses that
            and all(self._exists(name) or self.can_start(name) for name in nodes)
        )

    def missing(self) -> tuple[str, ...]:
        """Return nodes that were enabled and have gone."""
        return tuple(n for n in NODES if self._topics.enabled(n) and not self._exists(n))

    def conflict(self) -> str:
        """Return which nodes send targets at the same time; empty: none."""
        senders = [name for name in SENDERS if self._is_enabled(name)]
        if self._is_enabled(TRACKER) and len(senders) > 1:
            return f"{' and '.join(senders)} all send targets"
        return ""

    def look_at(self, frame: str, point: Vector3) -> None:
        """Send a target [m] once to `point_head`, periodically to `head_tracker`."""
        if frame not in self._buffer.frames():
            raise HeadTrackingError(f"The target is refused: there is no frame {frame!r}.")
        stops = self._stop.permit()
        if not self._changing.acquire(timeout=_BUSY):
            raise HeadTrackingError("The mode is being changed: try again in a moment.")
        try:
            mode, target = self._take_over(stops), Target(0, frame, point)
            model = self._buffer.model
            if mode is not Mode.POINT and model is not None:  # it is sent again and again
                in_root = self._buffer.transform_point(point, model.root, frame)
                target = Target(0, model.root, in_root)
            self._begin_sending(mode, repeat(target), stops)
        except TransformException as error:
            raise HeadTrackingError(f"The target is refused: {error}") from error
        finally:
            self._changing.release()

    def select(self, seen: Target) -> None:
        """Let `visual_target` follow what it has seen there."""
        self._stop.permit()
        if self.mode() not in FOUND_IN_PICTURES:
            raise HeadTrackingError("Choose Face, Ball or Marker first.")
        self._selections.publish(target_message(seen))

    def centre(self) -> None:
        """Recentre the head with its controller; what the camera finds there is followed."""
        stops = self._stop.permit()
        with self._changing:
            mode = self.mode()
            if mode not in FOUND_IN_PICTURES:
                mode = self._take_over(stops)
                self.stop_sending()
        self._stop.permit(stops)
        self._services.trigger(f"{_NODES[mode][0]}/recenter")

    def stop_sending(self) -> None:
        """Send no more targets."""
        with self._send_lock:
            self._sending = None
            self._timer.cancel()

    def set_mode(self, mode: Mode, frame: str = "") -> None:
        """Enable one controller and at most one node that sends it targets; disable all others.

        Nodes that are needed are started, where the run can do that. While the head is stopped,
        only OFF can be chosen. For any thread: a later choice ends a change that is in progress,
        and so does STOP. FOLLOW without a frame sends no targets until one is chosen.
        """
        stops = self._stop.count if mode is Mode.OFF else self._stop.permit()
        if mode is Mode.PATH:
            raise HeadTrackingError("This mode needs a path: see follow_path.")
        if mode is Mode.FOLLOW and frame and frame not in self._buffer.frames():
            raise HeadTrackingError(f"There is no frame {frame!r} to follow.")
        self._wanted = mode, frame
        if mode is Mode.OFF:
            self._disable(NODES)  # at once, without waiting for other changes
        with self._changing:
            self._change(mode, frame, stops)
            if mode is Mode.FOLLOW:
                targets = self._frame_targets(frame) if frame else repeat(None)
                self._begin_sending(mode, targets, stops)

    def follow_path(self, path: ClosedPath, speed: float) -> None:
        """Let the tracker follow a path in the model's root at a speed [m/s]."""
        stops = self._stop.permit()
        self._wanted = Mode.PATH, ""
        with self._changing:
            self._change(Mode.PATH, "", stops)
            self._begin_sending(Mode.PATH, self._path_targets(path, speed), stops)

    def _take_over(self, stops: int) -> Mode:
        """Let the page alone send targets; return the mode for that."""
        before = self.mode()
        mode = Mode.POINT if before is Mode.POINT else Mode.TRACK
        if before is Mode.OFF and mode not in self.possible():
            mode = Mode.POINT
        if mode is not before or any(map(self._is_enabled, SENDERS)):
            self._wanted = mode, ""
            self._change(mode, "", stops)
        return mode

    def _change(self, mode: Mode, frame: str, stops: int) -> None:
        """Enable the nodes of a mode and disable the others, until a STOP or another choice."""

        def ended() -> str:
            if self._stop.count != stops:
                return "The head was stopped before the mode was reached."
            return "" if self._wanted == (mode, frame) else "Another mode was chosen meanwhile."

        nodes = _NODES[mode]
        missing = [name for name in reversed(nodes) if not self._exists(name)]
        for name in missing:
            _refuse_if("" if self.can_start(name) else f"{name} is not running: start it first.")
        self.stop_sending()
        # a node that is started is enabled: nothing may turn the head before the mode is reached
        self._disable(n for n in NODES if missing or n not in nodes)
        for name in missing:
            self._services.trigger(f"node_starter/{name}")
            late = f"{name} was started and does not answer: try again."
            _wait(partial(self._services.offered, f"{name}/enable"), late, ended)
        if mode in _FOLLOWS:
            self._choose_target(mode, ended)
        for name in nodes:
            _refuse_if(ended())
            self._enable(name, True)

    def release(self) -> None:
        """Disable the controllers of the head, and wait until they have released the joints."""
        self.set_mode(Mode.OFF)
        _wait(
            lambda: not set(self._stop.owners.values()) & set(CONTROLLERS),
            "The controller of the head has not released the joints.",
        )

    def can_start(self, name: str) -> bool:
        """Return whether a node does not exist yet and the run can start it."""
        return self._services.offered(f"node_starter/{name}") and not self._exists(name)

    def _exists(self, name: str) -> bool:
        return name in self._graph.nodes or self._services.offered(f"{name}/enable")

    def _is_enabled(self, name: str) -> bool:
        """Return whether a node exists and has not published that it is disabled."""
        enabled = self._topics.enabled(name)
        if enabled is None:  # the graph is late, and costs less than the services
            return name in self._graph.nodes
        return enabled and self._exists(name)

    def _disable(self, names: Iterable[str]) -> None:
        for name in names:
            self._enable(name, False)

    def _enable(self, name: str, on: bool) -> None:
        """Enable or disable a node that is not so yet, and wait until it has published that."""
        service = f"{name}/enable"
        is_so = self._topics.enabled(name) is on and not self._stop.stopped  # until `resume` only
        if self._services.offered(service) and not is_so:
            self._services.switch(service, on)
            before, late = not on, f"{name} is still {'disabled' if on else 'enabled'}."
            _wait(lambda: self._topics.enabled(name) is not before, late)
        elif not on and self._is_enabled(name):
            raise HeadTrackingError(f"{name} can't be disabled: end it first.")
        elif not on and not self._exists(name):
            self._topics.forget(name)

    def _choose_target(self, mode: Mode, ended: Callable[[], str]) -> None:
        """Let `visual_target` follow something; a simulated camera is given a scene with it."""
        scene = self.value(CAMERA, "scene")
        if scene not in (None, "everything") and mode not in scene:  # by its name
            self.set_value(CAMERA, "scene", "everything")
        late = f"{VISUAL} does not tell what it follows: try again."  # it may just have started
        _wait(lambda: self.value(VISUAL, "follow") is not None, late, ended)
        if self.value(VISUAL, "follow") != _FOLLOWS[mode]:
            self.set_value(VISUAL, "follow", _FOLLOWS[mode])

    def value(self, node: str, name: str) -> Any:
        """Return a parameter of a node of this robot; None if it is not known."""
        owner = f"{self._graph.namespace.rstrip('/')}/{node}"
        for one in self._parameters.settings():
            if (one.node, one.name) == (owner, name):
                return one.value
        return None

    def set_value(self, node: str, name: str, value: Any) -> None:
        """Set a parameter of a node of this robot."""
        self._parameters.set(f"{self._graph.namespace.rstrip('/')}/{node}", name, value)

    def _begin_sending(self, mode: Mode, targets: Iterator[Target | None], stops: int) -> None:
        """Send targets, the first one at once or when the next one is due: never more often."""
        with self._send_lock:
            is_idle, self._sending = self._timer.is_canceled(), _Sending(mode, targets, stops)
            if is_idle:
                self._timer.reset()
        if is_idle:
            self._send_next()

    def _frame_targets(self, frame: str) -> Iterator[Target | None]:
        """Yield a frame as the target; None while it is not measured."""
        root = self._buffer.model.root if self._buffer.model is not None else frame
        follower = FrameTarget(self._buffer, FrameTargetParameters(frame, reference_frame=root))
        while True:
            self._poll()
            target = None
            with suppress(StaleFrameError, TransformException):
                target = follower.newest(self._node.get_clock().now().nanoseconds)
            yield target

    def _path_targets(self, path: ClosedPath, speed: float) -> Iterator[Target | None]:
        """Yield the present point of a path."""
        distance, before = 0.0, time.monotonic()
        while True:
            now, model = time.monotonic(), self._buffer.model
            distance += speed * min(now - before, 2.0 * _SEND_PERIOD)
            before = now
            stamp = self._node.get_clock().now().nanoseconds
            yield None if model is None else Target(stamp, model.root, path.at(distance))

    def _send_next(self) -> None:
        """Send the next target, unless a STOP, another mode or another sender has ended that."""
        with self._send_lock:
            sending = self._sending
            others = (n for n in SENDERS if self._topics.enabled(n) and self._exists(n))
            if sending is None or self._stop.count != sending.stops or any(others):
                self._sending = None
                self._timer.cancel()
                return
            target = next(sending.targets)
            if target is not None:
                self._targets.publish(target_message(target))
            if sending.mode is Mode.POINT:
                self._sending = None


def _wait(done: Callable[[], bool], late: str, ended: Callable[[], str] = str) -> None:
    """Wait until something is done.

    Raises:
        HeadTrackingError: it is not done in time (`late`), or `ended` returns a reason.
    """
    deadline = time.monotonic() + _PATIENCE
    while not done():
        _refuse_if(ended() or (late if time.monotonic() > deadline else ""))
        time.sleep(_POLL)
