"""What decides where the head looks: one node that turns it, one that sends targets."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from typing import Any, NamedTuple, ParamSpec

from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from head_tracking.compatibility import StrEnum
from head_tracking.page.other_topics import OtherTopics
from head_tracking.page.path import Path
from head_tracking.page.stop import Stop
from head_tracking.ros.kit.graph import Graph
from head_tracking.ros.kit.messages import target_message
from head_tracking.ros.kit.other_parameters import OtherParameters
from head_tracking.ros.kit.other_services import OtherServices, Outcome
from head_tracking.targets import FrameTarget, FrameTargetParameters, StaleFrameError
from head_tracking.tracking import Target, TargetState
from head_tracking.transforms import TransformBuffer, TransformException, Vector3

TRACKER, POINTER = "head_tracker", "point_head"
FICTITIOUS, VISUAL, MUX = "fictitious_target", "visual_target", "target_mux"
CAMERA = "simulated_camera"
CONTROLLERS = (TRACKER, POINTER)
SENDERS = (FICTITIOUS, VISUAL, MUX, "frame_target")

_SEND_PERIOD = 0.05  # s
_PATIENCE = 10.0  # s
_RELEASE = 1.0  # s in which a node that was switched off lets go of the joints
_REFUSAL = 0.8  # s
_REFUSED = "targets are refused: "
_POLL = 0.02  # s

P = ParamSpec("P")


class Mode(StrEnum):
    """What decides where the head looks."""

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


_NEEDED: Mapping[Mode, tuple[str, ...]] = {
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
"""The node that turns the head, and the one that sends targets if it is not the page."""

_FINDS: Mapping[Mode, str] = {Mode.FACE: "face", Mode.BALL: "colour", Mode.MARKER: "marker"}
"""What `visual_target` is to follow."""

FOUND_IN_PICTURES = (*_FINDS, Mode.VISUAL)
"""Modes in which `visual_target` sends the targets."""

_SHOWS: Mapping[Mode, tuple[str, ...]] = {
    Mode.FACE: ("face", "faces", "everything"),
    Mode.BALL: ("ball", "everything"),
    Mode.MARKER: ("marker", "everything"),
}
"""The scenes of a simulated camera in which that can be found."""


class _Refused(Exception):
    """What was asked for is not done; says why."""


def _refuse_if(reason: str) -> None:
    if reason:
        raise _Refused(reason)


def _text_of(outcome: Outcome) -> str:
    """Return what a request has answered; raise _Refused if it was not done."""
    if not outcome.done:
        raise _Refused(outcome.text)
    return outcome.text


def _answered(ask: Callable[P, str]) -> Callable[P, Outcome]:
    """Let a method that returns a sentence or raises _Refused return an Outcome."""

    @wraps(ask)
    def answered(*arguments: P.args, **options: P.kwargs) -> Outcome:
        try:
            return Outcome(True, ask(*arguments, **options))
        except _Refused as refusal:
            return Outcome(False, str(refusal))

    return answered


class _Sending(NamedTuple):
    """Targets that the page itself sends again and again.

    Attributes:
        mode: what they are sent for.
        target: the next one; None: nothing is sent now.
        stops: number of STOPs when that began; another one ends it.
    """

    mode: Mode
    target: Callable[[], Target | None]
    stops: int


class OtherNodes(NamedTuple):
    """How the page reaches the other nodes of a robot.

    Attributes:
        services: their switches.
        topics: what they say.
        graph: which of them are there.
        parameters: of them.
        buffer: the robot's frames.
        stop: until it is resumed nothing is commanded.
    """

    services: OtherServices
    topics: OtherTopics
    graph: Graph
    parameters: OtherParameters
    buffer: TransformBuffer
    stop: Stop


class HeadModes:
    """Switches the nodes of a head, and sends targets; for any thread.

    What is switched on is what the nodes say on their topics `~/enabled`. Nothing is remembered
    here but what the page itself sends.

    Args:
        node: sends targets.
        others: the nodes; a STOP ends what the page sends, and whatever is being switched on.
    """

    def __init__(self, node: Node, others: OtherNodes) -> None:
        self._node = node
        self._services, self._topics, self._graph, self._parameters, self._buffer, self._stop = (
            others
        )
        self._changing = threading.RLock()  # one change of modes at a time
        self._wanted = Mode.OFF, ""
        self._services.know(SetBool, *(f"{name}/enable" for name in (*CONTROLLERS, *SENDERS)))
        self._services.know(Trigger, *(f"{name}/recenter" for name in CONTROLLERS))
        self._services.know(
            Trigger,
            *(f"node_starter/{name}" for name in (*CONTROLLERS, FICTITIOUS, VISUAL, CAMERA)),
        )
        self._targets = node.create_publisher(PointStamped, "target_point", 10)
        self._sending: _Sending | None = None
        self._send_lock = threading.Lock()
        self.path: Path | None = None
        self._no_path = "there is no path yet"
        self._speed, self._along, self._stepped = 0.0, 0.0, 0.0
        self._timer = node.create_timer(_SEND_PERIOD, self._send_next)
        self._timer.cancel()

    def mode(self) -> Mode:
        """What decides where the head looks now."""
        if self._is_on(TRACKER):
            if self._is_on(VISUAL):
                follows = self.value(VISUAL, "follow")
                return next((mode for mode, it in _FINDS.items() if it == follows), Mode.VISUAL)
            for mode in (Mode.FICTITIOUS, Mode.MUX):
                if self._is_on(_NEEDED[mode][1]):
                    return mode
            sending = self._sending
            return Mode.TRACK if sending is None else sending.mode
        return Mode.POINT if self._is_on(POINTER) else Mode.OFF

    def possible(self) -> tuple[Mode, ...]:
        """The modes whose nodes are there, or can be started."""
        return tuple(
            mode
            for mode, needed in _NEEDED.items()
            if mode is not Mode.VISUAL  # that is what other nodes have chosen
            and all(self._is_there(name) or self.can_start(name) for name in needed)
        )

    def missing(self) -> tuple[str, ...]:
        """Nodes that were switched on when last heard of, and have gone."""
        return tuple(
            name
            for name in (*CONTROLLERS, *SENDERS)
            if self._topics.enabled(name) and not self._is_there(name)
        )

    def fighting(self) -> str:
        """Return which other programs control the head or send it targets; empty if none does."""
        both = [name for name in CONTROLLERS if self._is_on(name)]
        if len(both) > 1:
            return f"{' and '.join(both)} both turn the head"
        senders = [name for name in SENDERS if self._is_on(name)]
        if self._sending is not None:
            senders.append("this page")
        if self._is_on(TRACKER) and len(senders) > 1:
            return f"{' and '.join(senders)} all send targets"
        return ""

    @_answered
    def look_at(self, frame: str, point: Vector3, *, wait: bool = False) -> str:
        """Sends a target once, or again and again where a tracker needs that.

        Args:
            frame: the frame of the point.
            point: the target [m].
            wait: for a moment, for a refusal by the node that turns the head.
        """
        if not all(map(math.isfinite, point)):
            raise _Refused("the target is refused: x, y and z must be numbers in metres")
        if frame not in self._buffer.frames():
            raise _Refused(f"the target is refused: there is no frame {frame!r}")
        stops = self._stop.count
        _refuse_if(self._stop.refusal)
        before, sent = {name: self._topics.state(name) for name in CONTROLLERS}, time.monotonic()
        if not self._changing.acquire(timeout=_RELEASE):
            raise _Refused("the mode is being changed: try again in a moment")
        try:
            mode, changed = self._take_over()
            x, y, z = map(float, point)
            target = Target(0, frame, (x, y, z))
            self._send(target, mode, stops)
        finally:
            self._changing.release()
        name = _NEEDED[mode][0]
        while wait and time.monotonic() - sent < _REFUSAL:
            _refuse_if(self._refusal_of(name, before[name], sent))
            time.sleep(_POLL)
        return f"target {target} sent" + (f"; the mode is {mode} now" if changed else "")

    @_answered
    def centre(self) -> str:
        """Recentres with the node that turns the head now."""
        with self._changing:
            mode, _ = self._take_over()
            self.stop_sending()
        return _text_of(self._services.trigger(f"{_NEEDED[mode][0]}/recenter"))

    def stop_sending(self) -> None:
        """Sends no more targets."""
        with self._send_lock:
            self._sending = None
            self._timer.cancel()

    @_answered
    def set_mode(self, mode: Mode, frame: str = "") -> str:
        """Lets exactly one node turn the head, and exactly one send it targets.

        Nodes that are needed and do not run are started, where the run can do that. What turned
        the head before is switched off first. While the head is stopped only OFF can be chosen.
        For any thread: a later choice ends a change that is under way; STOP ends it, too.
        """
        _refuse_if(self._stop.refusal if mode is not Mode.OFF else "")
        if mode is Mode.FOLLOW and frame not in self._buffer.frames():
            raise _Refused(f"there is no frame {frame!r} to follow")
        _refuse_if(self._no_path if mode is Mode.PATH and self.path is None else "")
        stops = self._stop.count
        self._wanted = mode, frame
        if mode is Mode.OFF:
            self._disable((*SENDERS, *CONTROLLERS))  # at once, whatever another change waits for
        with self._changing:
            self._change(mode, frame, stops)
            if mode is Mode.FOLLOW:
                self._keep_sending(mode, self._next_of_frame(frame), stops)
            if mode is Mode.PATH:
                self._along, self._stepped = 0.0, time.monotonic()
                self._keep_sending(mode, self._next_of_path, stops)
        return f"mode: {mode}" + (f" {frame}" if mode is Mode.FOLLOW else "")

    def _take_over(self) -> tuple[Mode, bool]:
        """Let the page alone send targets; return the mode for that, and whether it is another."""
        before = self.mode()
        if before is Mode.OFF:
            raise _Refused("nothing turns the head now: choose a mode (point or track)")
        mode = Mode.POINT if before is Mode.POINT else Mode.TRACK
        if mode is not before or any(map(self._is_on, SENDERS)):
            _text_of(self.set_mode(mode))
        return mode, mode is not before

    def _change(self, mode: Mode, frame: str, stops: int) -> None:
        """Switch nodes on and off for a mode, until a STOP or another choice ends that."""

        def ended() -> str:
            if self._stop.count != stops:
                return "stopped before the mode was reached"
            return "" if self._wanted == (mode, frame) else "another mode was chosen meanwhile"

        needed = _NEEDED[mode]
        for name in needed:
            if not self._is_there(name):
                self._start(name, ended)
        if mode in _FINDS:
            self._find(mode, ended)
        self.stop_sending()
        self._disable(name for name in (*SENDERS, *CONTROLLERS) if name not in needed)
        for name in needed:
            _refuse_if(ended())
            self._enable(name, True)

    def set_path(self, path: Path | None, speed: float, why: str = "") -> None:
        """The path to look along in that mode.

        Args:
            path: in the model's root; None: there is none, and the head stays where it is.
            speed: along it [m/s].
            why: there is none.
        """
        self.path, self._speed, self._no_path = path, speed, why

    @_answered
    def release(self) -> str:
        """Disable the controllers of the head, and wait until they have released the joints."""
        said = _text_of(self.set_mode(Mode.OFF))
        _wait(
            lambda: not set(self._topics.owners().values()) & set(CONTROLLERS),
            "the controller of the head has not released the joints",
            patience=_RELEASE,
        )
        return said

    def can_start(self, name: str) -> bool:
        """Whether a node does not run yet, and whoever runs the robot can start it."""
        return self._services.offered(f"node_starter/{name}") and not self._is_there(name)

    def start(self, name: str) -> Outcome:
        """Starts a node of the run, if whoever runs it can."""
        if not self._services.offered(f"node_starter/{name}"):
            return Outcome(False, f"{name} is not running; start it for this mode")
        return self._services.trigger(f"node_starter/{name}")

    def _refusal_of(self, name: str, before: str, sent: float) -> str:
        """Return what a node has against a target that was sent then [s, monotonic]; or nothing.

        Args:
            name: the node.
            before: its state before the target was sent.
            sent: when that was [s, monotonic].
        """
        state, logged = self._topics.state(name), self._topics.complaint(name, sent)
        if state != before and state.startswith(TargetState.AT_LIMIT):
            return state
        in_state = state.partition(_REFUSED)[2] if state != before else ""
        return in_state or (logged if "refused" in logged else "")

    def _send(self, target: Target, mode: Mode, stops: int) -> None:
        """Send a target, again and again where a tracker needs that."""
        model = self._buffer.model
        if mode is Mode.POINT or model is None:
            self.stop_sending()
            self._publish(target)
            return
        try:
            placed = self._buffer.transform_point(target.point, model.root, target.frame_id)
        except TransformException as error:
            raise _Refused(f"the target is refused: {error}") from error
        kept = Target(0, model.root, placed)
        self._keep_sending(mode, lambda: kept, stops)

    def _publish(self, target: Target) -> None:
        self._targets.publish(target_message(target))

    def _start(self, name: str, ended: Callable[[], str]) -> None:
        """Starts a node and waits until it can be switched off again: only one turns the head."""
        _text_of(self.start(name))
        late = f"{name} was started and does not answer; try again"
        _wait(lambda: self._services.offered(f"{name}/enable"), late, ended)

    def _is_there(self, name: str) -> bool:
        return self._services.offered(f"{name}/enable") or name in self._graph.nodes

    def _is_on(self, name: str) -> bool:
        """Whether a node is there and says that it is switched on, or does not say that it is off.

        One that has no topic `~/enabled` cannot be switched off, or not be known to be.
        """
        return self._is_there(name) and self._topics.enabled(name) is not False

    def _disable(self, names: Iterable[str]) -> None:
        for name in names:
            self._enable(name, False)

    def _enable(self, name: str, on: bool) -> None:
        """Switches a node on or off, if that can be switched and is not so already."""
        service = f"{name}/enable"
        if self._services.offered(service) and self._topics.enabled(name) is not on:
            _text_of(self._services.switch(service, on))
            before, late = not on, f"{name} says that it is {'off' if on else 'on'} still"
            _wait(lambda: self._topics.enabled(name) is not before, late, patience=_RELEASE)
        elif not on and self._is_on(name):
            raise _Refused(f"{name} can't be switched off; end it first")
        elif not on and not self._is_there(name):
            self._topics.forget(name)

    def _find(self, mode: Mode, ended: Callable[[], str]) -> None:
        """Lets `visual_target` look for something; in a simulated room there is one."""
        scene = self.value(CAMERA, "scene")
        if scene is not None and scene not in _SHOWS[mode]:
            self.set_value(CAMERA, "scene", "everything")
        late = f"{VISUAL} does not say what it follows; try again"  # it has only just been started
        _wait(lambda: self.value(VISUAL, "follow") is not None, late, ended)
        if self.value(VISUAL, "follow") != _FINDS[mode]:
            _text_of(self.set_value(VISUAL, "follow", _FINDS[mode]))

    def value(self, node: str, name: str) -> Any:
        """A parameter of a node of this robot; None if it is not known."""
        owner = f"{self._graph.namespace.rstrip('/')}/{node}"
        return next(
            (
                one.value
                for one in self._parameters.settings()
                if (one.node, one.name) == (owner, name)
            ),
            None,
        )

    def set_value(self, node: str, name: str, value: Any) -> Outcome:
        """Set a parameter of a node of this robot."""
        return self._parameters.set(f"{self._graph.namespace.rstrip('/')}/{node}", name, value)

    def _keep_sending(self, mode: Mode, target: Callable[[], Target | None], stops: int) -> None:
        with self._send_lock:
            self._sending = _Sending(mode, target, stops)
            self._timer.reset()
        self._send_next()

    def _next_of_frame(self, frame: str) -> Callable[[], Target | None]:
        """Return what finds the next target of a frame; nothing while nobody says where it is."""
        root = self._buffer.model.root if self._buffer.model is not None else frame
        follower = FrameTarget(self._buffer, FrameTargetParameters(frame, reference_frame=root))

        def newest() -> Target | None:
            try:
                return follower.newest(self._node.get_clock().now().nanoseconds)
            except (StaleFrameError, TransformException):
                return None

        return newest

    def _next_of_path(self) -> Target | None:
        now, model, path = time.monotonic(), self._buffer.model, self.path
        self._along += self._speed * min(now - self._stepped, 2.0 * _SEND_PERIOD)
        self._stepped = now
        if path is None or model is None:
            return None
        stamp = self._node.get_clock().now().nanoseconds
        return Target(stamp, model.root, path.at(self._along))

    def _send_next(self) -> None:
        """Send the next target, unless a STOP or another mode has ended that."""
        with self._send_lock:
            sending = self._sending
            if sending is None or self._stop.count != sending.stops:
                self._sending = None
                self._timer.cancel()
                return
            target = sending.target()
            if target is not None:
                self._publish(target)


def _wait(
    done: Callable[[], bool], late: str, ended: Callable[[], str] = str, patience: float = _PATIENCE
) -> None:
    """Wait until something is done.

    Args:
        done: what is waited for.
        late: the refusal if it is not done in time.
        ended: why it is waited for no longer; empty: it is.
        patience: how long it may take [s].

    Raises:
        _Refused: it is not done.
    """
    deadline = time.monotonic() + patience
    while not done():
        _refuse_if(ended() or (late if time.monotonic() > deadline else ""))
        time.sleep(_POLL)
