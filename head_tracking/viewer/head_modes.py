"""What decides where the head looks: one node that turns it, one that sends targets."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import Any

from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from head_tracking.ros.graph import Graph
from head_tracking.ros.messages import target_message
from head_tracking.ros.other_parameters import OtherParameters
from head_tracking.ros.other_services import OtherServices, Outcome
from head_tracking.tracking import Target, TargetState
from head_tracking.transforms import TransformBuffer, TransformException, Vector3
from head_tracking.viewer.other_topics import OtherTopics
from head_tracking.viewer.path import Path
from head_tracking.viewer.stop import Stop

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

_SHOWS: Mapping[Mode, tuple[str, ...]] = {
    Mode.FACE: ("face", "faces", "everything"),
    Mode.BALL: ("ball", "everything"),
    Mode.MARKER: ("marker", "everything"),
}
"""The scenes of a simulated camera in which that can be found."""


class HeadModes:
    """Switches the nodes of a head, and sends targets; for any thread.

    What is switched on is what the nodes say on their topics `~/enabled`. Nothing is remembered
    here but what the page itself sends.

    Args:
        node: sends targets.
        services: the switches of the nodes.
        topics: what the nodes say.
        graph: the nodes that are there.
        parameters: of those nodes: what the camera is to find.
        buffer: the robot's frames.
        stop: ends what the page sends, and whatever is being switched on.
    """

    def __init__(
        self,
        node: Node,
        services: OtherServices,
        topics: OtherTopics,
        graph: Graph,
        parameters: OtherParameters,
        buffer: TransformBuffer,
        stop: Stop,
    ) -> None:
        self._node = node
        self._services = services
        self._topics = topics
        self._graph = graph
        self._parameters = parameters
        self._buffer = buffer
        self._stop = stop
        self._stops = 0  # of the head, when what is sent was begun
        services.know(SetBool, *(f"{name}/enable" for name in (*CONTROLLERS, *SENDERS)))
        services.know(Trigger, *(f"{name}/recenter" for name in CONTROLLERS))
        services.know(
            Trigger,
            *(f"node_starter/{name}" for name in (*CONTROLLERS, FICTITIOUS, VISUAL, CAMERA)),
        )
        self._targets = node.create_publisher(PointStamped, "target_point", 10)
        self._kept: Callable[[], Target | None] | None = None
        self._sends = Mode.TRACK
        self.path: Path | None = None
        self._no_path = "there is no path yet"
        self._speed, self._along, self._stepped = 0.0, 0.0, 0.0
        self._timer = node.create_timer(_SEND_PERIOD, self._send_kept)
        self._timer.cancel()

    def mode(self) -> Mode:
        """What decides where the head looks now."""
        if self._is_on(TRACKER):
            if self._is_on(VISUAL):
                follows = self._value(VISUAL, "follow")
                return next((mode for mode, it in _FINDS.items() if it == follows), Mode.VISUAL)
            for mode in (Mode.FICTITIOUS, Mode.MUX):
                if self._is_on(_NEEDED[mode][1]):
                    return mode
            return Mode.TRACK if self._kept is None else self._sends
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
        """Who turns the head, or sends it targets, beside who should; empty if nobody does."""
        both = [name for name in CONTROLLERS if self._is_on(name)]
        if len(both) > 1:
            return f"{' and '.join(both)} both turn the head"
        senders = [name for name in SENDERS if self._is_on(name)]
        if self._kept is not None:
            senders.append("this page")
        if self._is_on(TRACKER) and len(senders) > 1:
            return f"{' and '.join(senders)} all send targets"
        return ""

    def look_at(self, frame: str, point: Vector3, *, wait: bool = False) -> Outcome:
        """Sends a target once, or again and again where a tracker needs that.

        Args:
            frame: the frame of the point.
            point: the target [m].
            wait: for a moment, for a refusal by the node that turns the head.
        """
        if self._services.hold.reason:
            return Outcome(False, self._services.hold.reason)
        if not all(map(math.isfinite, point)):
            return Outcome(False, "the target is refused: x, y and z must be numbers in metres")
        if frame not in self._buffer.frames():
            return Outcome(False, f"the target is refused: there is no frame {frame!r}")
        stops, mode, said = self._stop.count, self.mode(), ""
        if self._stop.refusal:
            return Outcome(False, self._stop.refusal)
        if mode is Mode.OFF:
            return Outcome(False, "nothing turns the head now: choose a mode (point or track)")
        wanted = Mode.POINT if mode is Mode.POINT else Mode.TRACK
        if mode is not wanted or any(map(self._is_on, SENDERS)):
            outcome = self.set_mode(wanted, "")
            if not outcome.done:
                return outcome
            said = f"; the mode is {wanted} now" if mode is not wanted else ""
        x, y, z = map(float, point)
        target = Target(0, frame, (x, y, z))
        text = f"target {target} sent{said}"
        model = self._buffer.model
        if wanted is Mode.POINT or model is None:
            self.stop_sending()
            refused = self._refusal_of(POINTER, wait, lambda: self._publish(target))
            return Outcome(not refused, refused or text)
        try:
            placed = self._buffer.transform_point(point, model.root, frame)
        except TransformException as error:
            return Outcome(False, f"the target is refused: {error}")
        kept = Target(0, model.root, placed)
        refused = self._refusal_of(
            TRACKER, wait, lambda: self._keep_sending(Mode.TRACK, lambda: kept, stops)
        )
        return Outcome(not refused, refused or text)

    def centre(self) -> Outcome:
        """Recentres with the node that turns the head now."""
        if self._services.hold.reason:
            return Outcome(False, self._services.hold.reason)
        mode = self.mode()
        if mode is Mode.OFF:
            return Outcome(False, "nothing turns the head now: choose a mode (point or track)")
        if mode not in (Mode.POINT, Mode.TRACK):
            outcome = self.set_mode(Mode.TRACK, "")
            if not outcome.done:
                return outcome
        self.stop_sending()
        return self._services.trigger(f"{_NEEDED[mode][0]}/recenter")

    def stop_sending(self) -> None:
        """Sends no more targets."""
        self._kept = None
        self._timer.cancel()

    def set_mode(self, mode: Mode, frame: str = "") -> Outcome:
        """Lets exactly one node turn the head, and exactly one send it targets.

        Nodes that are needed and do not run are started, where the run can do that. What turned
        the head before is switched off first. While the head is stopped only OFF can be chosen.
        """
        if self._services.hold.reason:
            return Outcome(False, self._services.hold.reason)
        if self._stop.refusal and mode is not Mode.OFF:
            return Outcome(False, self._stop.refusal)
        if mode is Mode.FOLLOW and frame not in self._buffer.frames():
            return Outcome(False, f"there is no frame {frame!r} to follow")
        if mode is Mode.PATH and self.path is None:
            return Outcome(False, self._no_path)
        stops, needed = self._stop.count, _NEEDED[mode]
        for name in needed:
            if not self._is_there(name):
                outcome = self._start(name)
                if not outcome.done:
                    return outcome
        if mode in _FINDS:
            outcome = self._find(mode)
            if not outcome.done:
                return outcome
        self.stop_sending()
        others = [name for name in (*SENDERS, *CONTROLLERS) if name not in needed]
        for name, on in (*((name, False) for name in others), *((name, True) for name in needed)):
            if on and self._stop.count != stops:
                return Outcome(False, f"stopped before {name} was switched on")
            outcome = self._enable(name, on)
            if not outcome.done:
                return outcome
        if mode is Mode.FOLLOW:
            kept = Target(0, frame, (0.0, 0.0, 0.0))
            self._keep_sending(mode, lambda: kept, stops)
        if mode is Mode.PATH:
            self._along, self._stepped = 0.0, time.monotonic()
            self._keep_sending(mode, self._next_of_path, stops)
        return Outcome(True, f"mode: {mode}" + (f" {frame}" if mode is Mode.FOLLOW else ""))

    def set_path(self, path: Path | None, speed: float, why: str = "") -> None:
        """The path to look along in that mode.

        Args:
            path: in the model's root; None: there is none, and the head stays where it is.
            speed: along it [m/s].
            why: there is none.
        """
        self.path, self._speed, self._no_path = path, speed, why

    def release(self) -> Outcome:
        """Switches off what turns the head, and waits until it has let go of the joints."""
        outcome = self.set_mode(Mode.OFF)
        deadline = time.monotonic() + _RELEASE
        while outcome.done and time.monotonic() < deadline:
            if not set(self._topics.owners().values()) & set(CONTROLLERS):
                break
            time.sleep(_POLL)
        return outcome

    def can_start(self, name: str) -> bool:
        """Whether a node does not run yet, and whoever runs the robot can start it."""
        return self._services.offered(f"node_starter/{name}") and not self._is_there(name)

    def start(self, name: str) -> Outcome:
        """Starts a node of the run, if whoever runs it can."""
        if not self._services.offered(f"node_starter/{name}"):
            return Outcome(False, f"{name} is not running; start it for this mode")
        return self._services.trigger(f"node_starter/{name}")

    def _refusal_of(self, name: str, wait: bool, send: Callable[[], None]) -> str:
        """What a node has against a target, if it says so within a moment after it was sent."""
        before, sent = self._topics.state(name), time.monotonic()
        send()
        while wait and time.monotonic() - sent < _REFUSAL:
            state = self._topics.state(name)
            in_state = ""
            if state != before:
                at_limit = state if state.startswith(TargetState.AT_LIMIT) else ""
                in_state = at_limit or state.partition(_REFUSED)[2]
            logged = self._topics.complaint(name, sent)
            said = in_state or (logged if "refused" in logged else "")
            if said:
                return said
            time.sleep(_POLL)
        return ""

    def _publish(self, target: Target) -> None:
        self._targets.publish(target_message(target))

    def _start(self, name: str) -> Outcome:
        """Starts a node and waits until it can be switched off again: only one turns the head."""
        outcome = self.start(name)
        deadline = time.monotonic() + _PATIENCE
        while outcome.done and not self._services.offered(f"{name}/enable"):
            if time.monotonic() > deadline:
                return Outcome(False, f"{name} was started and does not answer; try again")
            time.sleep(_POLL)
        return outcome

    def _is_there(self, name: str) -> bool:
        return self._services.offered(f"{name}/enable") or name in self._graph.nodes

    def _is_on(self, name: str) -> bool:
        """Whether a node is there and says that it is switched on, or does not say that it is off.

        One that has no topic `~/enabled` cannot be switched off, or not be known to be.
        """
        return self._is_there(name) and self._topics.enabled(name) is not False

    def _enable(self, name: str, on: bool) -> Outcome:
        """Switches a node on or off, if that can be switched and is not so already."""
        service = f"{name}/enable"
        if self._services.offered(service) and self._topics.enabled(name) is not on:
            outcome = self._services.switch(service, on)
            deadline = time.monotonic() + _RELEASE
            while outcome.done and self._topics.enabled(name) is (not on):
                if time.monotonic() > deadline:
                    return Outcome(False, f"{name} says that it is {'off' if on else 'on'} still")
                time.sleep(_POLL)
            return outcome
        if not on and self._is_on(name):
            return Outcome(False, f"{name} can't be switched off; end it first")
        if not on and not self._is_there(name):
            self._topics.forget(name)
        return Outcome(True, "")

    def _find(self, mode: Mode) -> Outcome:
        """Lets `visual_target` look for something; in a simulated room there is one."""
        scene = self._value(CAMERA, "scene")
        if scene is not None and scene not in _SHOWS[mode]:
            self._set(CAMERA, "scene", "everything")
        deadline = time.monotonic() + _PATIENCE
        while (follows := self._value(VISUAL, "follow")) is None:  # it has only just been started
            if time.monotonic() > deadline:
                return Outcome(False, f"{VISUAL} does not say what it follows; try again")
            time.sleep(_POLL)
        return (
            Outcome(True, "")
            if follows == _FINDS[mode]
            else self._set(VISUAL, "follow", _FINDS[mode])
        )

    def _value(self, node: str, name: str) -> Any:
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

    def _set(self, node: str, name: str, value: Any) -> Outcome:
        return self._parameters.set(f"{self._graph.namespace.rstrip('/')}/{node}", name, value)

    def _keep_sending(self, mode: Mode, target: Callable[[], Target | None], stops: int) -> None:
        self._kept, self._sends, self._stops = target, mode, stops
        self._send_kept()
        self._timer.reset()

    def _next_of_path(self) -> Target | None:
        now, model, path = time.monotonic(), self._buffer.model, self.path
        self._along += self._speed * min(now - self._stepped, 2.0 * _SEND_PERIOD)
        self._stepped = now
        if path is None or model is None:
            return None
        stamp = self._node.get_clock().now().nanoseconds
        return Target(stamp, model.root, path.at(self._along))

    def _send_kept(self) -> None:
        if self._stop.count != self._stops:
            self.stop_sending()
        target = None if self._kept is None else self._kept()
        if target is not None:
            self._publish(target)
