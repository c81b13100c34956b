"""What decides where the head looks: one node that turns it, one that sends targets."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from enum import StrEnum

from geometry_msgs.msg import Point, PointStamped
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from head_tracking.tracking import Target, TargetState
from head_tracking.transforms import TransformBuffer, TransformException, Vector3
from head_tracking.viewer.graph import Graph
from head_tracking.viewer.observation import Outcome
from head_tracking.viewer.other_services import OtherServices
from head_tracking.viewer.other_topics import OtherTopics

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
    FOLLOW = "follow a frame"
    FICTITIOUS = "fictitious target"
    VISUAL = "what the camera finds"
    MUX = "target_mux"


_NEEDED: Mapping[Mode, tuple[str, ...]] = {
    Mode.OFF: (),
    Mode.POINT: (POINTER,),
    Mode.TRACK: (TRACKER,),
    Mode.FOLLOW: (TRACKER,),
    Mode.FICTITIOUS: (TRACKER, FICTITIOUS),
    Mode.VISUAL: (TRACKER, VISUAL),
    Mode.MUX: (TRACKER, MUX),
}
"""The node that turns the head, and the one that sends targets if it is not the page."""


class HeadModes:
    """Switches the nodes of a head, and sends targets; for any thread.

    What is switched on is what the nodes say on their topics `~/enabled`. Nothing is remembered
    here but what the page itself sends.

    Args:
        node: sends targets.
        services: the switches of the nodes.
        topics: what the nodes say.
        graph: the nodes that are there.
        buffer: the robot's frames.
    """

    def __init__(
        self,
        node: Node,
        services: OtherServices,
        topics: OtherTopics,
        graph: Graph,
        buffer: TransformBuffer,
    ) -> None:
        self._node = node
        self._services = services
        self._topics = topics
        self._graph = graph
        self._buffer = buffer
        services.know(SetBool, *(f"{name}/enable" for name in (*CONTROLLERS, *SENDERS)))
        services.know(Trigger, *(f"{name}/recenter" for name in CONTROLLERS))
        services.know(
            Trigger, *(f"node_starter/{name}" for name in (*CONTROLLERS, FICTITIOUS, CAMERA))
        )
        self._targets = node.create_publisher(PointStamped, "target_point", 10)
        self._kept: PointStamped | None = None
        self._follows = False
        self._timer = node.create_timer(_SEND_PERIOD, self._send_kept)
        self._timer.cancel()

    def mode(self) -> Mode:
        """What decides where the head looks now."""
        if self._is_on(TRACKER):
            for mode in (Mode.FICTITIOUS, Mode.VISUAL, Mode.MUX):
                if self._is_on(_NEEDED[mode][1]):
                    return mode
            return Mode.FOLLOW if self._follows else Mode.TRACK
        return Mode.POINT if self._is_on(POINTER) else Mode.OFF

    def possible(self) -> tuple[Mode, ...]:
        """The modes whose nodes are there, or can be started."""
        return tuple(
            mode
            for mode, needed in _NEEDED.items()
            if all(self._is_there(name) or self.can_start(name) for name in needed)
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
        mode, said = self.mode(), ""
        if mode is Mode.OFF:
            return Outcome(False, "nothing turns the head now: choose a mode (point or track)")
        wanted = Mode.POINT if mode is Mode.POINT else Mode.TRACK
        if mode is not wanted or any(map(self._is_on, SENDERS)):
            outcome = self.set_mode(wanted, "")
            if not outcome.done:
                return outcome
            said = f"; the mode is {wanted} now" if mode is not wanted else ""
        text = f"target {Target(0, frame, point)} sent{said}"
        model = self._buffer.model
        if wanted is Mode.POINT or model is None:
            self.stop_sending()
            refused = self._refusal_of(POINTER, wait, lambda: self._publish(frame, point))
            return Outcome(not refused, refused or text)
        try:
            placed = self._buffer.transform_point(point, model.root, frame)
        except TransformException as error:
            return Outcome(False, f"the target is refused: {error}")
        self._follows = False
        refused = self._refusal_of(TRACKER, wait, lambda: self._keep_sending(model.root, placed))
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
        self._kept, self._follows = None, False
        self._timer.cancel()

    def set_mode(self, mode: Mode, frame: str = "") -> Outcome:
        """Lets exactly one node turn the head, and exactly one send it targets.

        Nodes that are needed and do not run are started, where the run can do that. What turned
        the head before is switched off first.
        """
        if self._services.hold.reason:
            return Outcome(False, self._services.hold.reason)
        if mode is Mode.FOLLOW and frame not in self._buffer.frames():
            return Outcome(False, f"there is no frame {frame!r} to follow")
        needed = _NEEDED[mode]
        for name in needed:
            if not self._is_there(name):
                outcome = self._start(name)
                if not outcome.done:
                    return outcome
        self.stop_sending()
        others = [name for name in (*SENDERS, *CONTROLLERS) if name not in needed]
        for name, on in (*((name, False) for name in others), *((name, True) for name in needed)):
            outcome = self._enable(name, on)
            if not outcome.done:
                return outcome
        if mode is Mode.FOLLOW:
            self._keep_sending(frame, (0.0, 0.0, 0.0))
            self._follows = True
        return Outcome(True, f"mode: {mode}" + (f" {frame}" if mode is Mode.FOLLOW else ""))

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
        if self._services.hold.reason:
            return Outcome(False, self._services.hold.reason)
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

    def _publish(self, frame: str, point: Vector3) -> None:
        self._targets.publish(_message(frame, point))

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

    def _keep_sending(self, frame: str, point: Vector3) -> None:
        self._kept = _message(frame, point)
        self._send_kept()
        self._timer.reset()

    def _send_kept(self) -> None:
        kept = self._kept
        if kept is not None:
            self._targets.publish(kept)


def _message(frame: str, point: Vector3) -> PointStamped:
    x, y, z = map(float, point)
    message = PointStamped(point=Point(x=x, y=y, z=z))
    message.header.frame_id = frame
    return message
