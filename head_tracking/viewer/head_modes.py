"""What decides where the head looks: the nodes that turn it, and those that send targets."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping

from rclpy.node import Node

from head_tracking.tracking import Target
from head_tracking.transforms import TransformBuffer, TransformException, Vector3
from head_tracking.viewer.robot import Mode, Outcome
from head_tracking.viewer.running_services import RunningServices
from head_tracking.viewer.target_sender import TargetSender

TRACKER, POINTER, FICTITIOUS = "head_tracker", "point_head", "fictitious_target"
CAMERA = "simulated_camera"

_PATIENCE = 10.0  # s
_POLL = 0.02  # s
_NEEDED: Mapping[Mode, tuple[str, ...]] = {
    Mode.POINT: (POINTER,),
    Mode.TRACK: (TRACKER,),
    Mode.FICTITIOUS: (TRACKER, FICTITIOUS),
    Mode.FOLLOW: (TRACKER,),
}


class HeadModes:
    """Switches the nodes of a head, and sends targets; for any thread.

    Args:
        node: sends targets.
        services: the switches of the nodes.
        buffer: the robot's frames.
        running: the nodes that are there.
    """

    def __init__(
        self,
        node: Node,
        services: RunningServices,
        buffer: TransformBuffer,
        running: Callable[[], tuple[str, ...]],
    ) -> None:
        self._services = services
        self._buffer = buffer
        self._running = running
        self._sender = TargetSender(node)
        self._mode: Mode | None = None
        self._switched: dict[str, bool] = {}
        self._needed: tuple[str, ...] = ()

    def mode(self) -> Mode | None:
        """What decides where the head looks, as it was set here or as the nodes suggest."""
        if self._mode is not None:
            return self._mode
        if self._is_there(TRACKER):
            return Mode.FICTITIOUS if self._is_there(FICTITIOUS) else Mode.TRACK
        return Mode.POINT if self._is_there(POINTER) else None

    def missing(self) -> tuple[str, ...]:
        """Nodes that have gone, so that the mode does not do what it says."""
        mode = self.mode()
        if mode is not None:
            self._needed = _NEEDED[mode]
        return tuple(name for name in self._needed if not self._is_there(name))

    def tracking(self) -> bool | None:
        """Whether the tracker turns the head."""
        if not self._offers_enable(TRACKER):
            self._switched.pop(TRACKER, None)  # it is on when it comes back
            return None
        return self._switched.get(TRACKER, True)

    def look_at(self, frame: str, point: Vector3) -> Outcome:
        """Sends a target once, or again and again where a tracker needs that."""
        if not all(map(math.isfinite, point)):
            return Outcome(False, "the target is refused: x, y and z must be numbers in metres")
        if frame not in self._buffer.frames():
            return Outcome(False, f"the target is refused: there is no frame {frame!r}")
        mode, said = self.mode(), ""
        if mode in (Mode.FICTITIOUS, Mode.FOLLOW):
            outcome = self.set_mode(Mode.TRACK, "")
            if not outcome.done:
                return outcome
            said = f"; the mode is {Mode.TRACK} now"
        text = f"target {Target(0, frame, point)} sent{said}"
        model = self._buffer.model
        if self.mode() is Mode.POINT or model is None:
            self._sender.send_once(frame, point)
            return Outcome(True, text)
        root = model.root
        try:
            placed = self._buffer.transform_point(point, root, frame)
        except TransformException as error:
            return Outcome(False, f"the target is refused: {error}")
        self._sender.keep_sending(root, placed)
        return Outcome(True, text)

    def centre(self) -> Outcome:
        """Recentres with the node that turns the head now."""
        self._sender.stop()
        wanted = POINTER if self.mode() is Mode.POINT else TRACKER
        services = self._services.names(f"/{wanted}/recenter") or self._services.names("/recenter")
        if not services:
            return Outcome(False, "nobody recentres the head: start point_head or head_tracker")
        if wanted == TRACKER and self.mode() is Mode.FICTITIOUS:
            self.set_mode(Mode.TRACK, "")
        return self._services.trigger(services[0])

    def stop_sending(self) -> None:
        """Sends no more targets."""
        self._sender.stop()

    def set_mode(self, mode: Mode, frame: str) -> Outcome:
        """Switches the nodes that send targets and turn the head; starts those it needs."""
        needed = _NEEDED[mode]
        for name in needed:
            if not self._is_there(name):
                outcome = self._start_switchable(name)
                if not outcome.done:
                    return outcome
        if mode is Mode.FOLLOW and frame not in self._buffer.frames():
            return Outcome(False, f"there is no frame {frame!r} to follow")
        for name in (TRACKER, POINTER, FICTITIOUS):
            outcome = self._enable(name, name in needed)
            if not outcome.done:
                return outcome
        self._mode = mode
        if mode is Mode.FOLLOW:
            self._sender.keep_sending(frame, (0.0, 0.0, 0.0))
        else:
            self._sender.stop()
        return Outcome(True, f"mode: {mode}" + (f" {frame}" if mode is Mode.FOLLOW else ""))

    def set_tracking(self, on: bool) -> Outcome:
        """Switches the tracker on or off."""
        if not self._offers_enable(TRACKER):
            return Outcome(False, f"{TRACKER} is not running")
        return self._enable(TRACKER, on)

    def can_start(self, name: str) -> bool:
        """Whether a node does not run yet, and whoever runs the robot can start it."""
        return bool(self._services.names(f"/node_starter/{name}")) and not self._is_there(name)

    def start(self, name: str) -> Outcome:
        """Starts a node of the run, if whoever runs it can."""
        services = self._services.names(f"/node_starter/{name}")
        if not services:
            return Outcome(False, f"{name} is not running; start it for this mode")
        return self._services.trigger(services[0])

    def _start_switchable(self, name: str) -> Outcome:
        """Starts a node and waits until it can be switched off again: only one turns the head."""
        outcome = self.start(name)
        deadline = time.monotonic() + _PATIENCE
        while outcome.done and not self._offers_enable(name):
            if time.monotonic() > deadline:
                return Outcome(False, f"{name} was started and does not answer; try again")
            time.sleep(_POLL)
        return outcome

    def _is_there(self, name: str) -> bool:
        return self._offers_enable(name) or any(
            one.rsplit("/", 1)[-1] == name for one in self._running()
        )

    def _offers_enable(self, name: str) -> bool:
        return bool(self._services.names(f"/{name}/enable"))

    def _enable(self, name: str, on: bool) -> Outcome:
        """Switches a node on or off, if that can be switched and is not so already."""
        services = self._services.names(f"/{name}/enable")
        if not services or self._switched.get(name, True) is on:
            return Outcome(True, "")
        outcome = self._services.switch(services[0], on)
        if outcome.done:
            self._switched[name] = on
        return outcome
