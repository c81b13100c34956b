"""A node that turns a head, and around it a robot whose clock, servos and model can do anything."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, PointStamped
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String
from std_srvs.srv import SetBool
from waiting import failing_waits, join, wait_for

from head_tracking.ros.kit.spinning import NodeThreads
from head_tracking.ros.kit.topics import LATCHED
from head_tracking.transforms import TransformBuffer

JOINTS = ("head_pan_joint", "head_tilt_joint")
_PERIOD = 0.02


class Head:
    """Publishes what a robot does 50 times a second, and obeys `joint_commands`.

    Args:
        make: the node under test, from options.
        urdf: the robot's model; empty: nobody publishes one.
        simulated: the node follows /clock.
        parameters: of the node.

    Attributes:
        offset: of the robot's clock from the machine's [s].
        clock_rate: /clock messages a second; 0: none.
        paused: the robot's clock stands still.
        measured: joint states are published.
        stamped_ahead: joint states are stamped so far in the future [s].
        speeds: that the joints were commanded [rad/s].
        each_period: is called.
        target: is published 30 times a second: frame and a function of the robot's time.
    """

    def __init__(self, make: Any, urdf: str, *, simulated: bool = False, **parameters: Any) -> None:
        self.offset = 0.0
        self.clock_rate = 50.0 if simulated else 0.0
        self.paused = False
        self.measured = True
        self.stamped_ahead = 0.0
        self.target: Any = None
        self.each_period: Callable[[], None] = lambda: None
        self.states: list[str] = []
        self.fields: dict[str, str] = {}
        self.errors: list[float] = []
        self.log: list[str] = []
        self.positions = [0.0, 0.0]
        self.travel: list[tuple[float, float]] = []
        self.commands = 0
        self._goals, self.speeds = [0.0, 0.0], [0.0, 0.0]
        self._stopped = threading.Event()
        with ExitStack() as resources:
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
            resources.callback(rclpy.try_shutdown)
            self.threads = resources.enter_context(closing(NodeThreads()))
            resources.enter_context(failing_waits(self.threads))
            self.robot: Node = rclpy.create_node("robot")
            self._joints = self.robot.create_publisher(JointState, "joint_states", 10)
            self._targets = self.robot.create_publisher(PointStamped, "target_point", 10)
            self._clock = self.robot.create_publisher(Clock, "/clock", 10)
            self._models = self.robot.create_publisher(String, "robot_description", LATCHED)
            self.robot.create_subscription(JointState, "joint_commands", self._on_command, 10)
            for name in ("head_tracker", "point_head"):
                self.robot.create_subscription(
                    DiagnosticStatus, f"{name}/status", self._on_status, LATCHED
                )
            for topic in ("head_tracker/tracking_error", "point_head/pointing_error"):
                self.robot.create_subscription(
                    Float64, topic, lambda m: self.errors.append(m.data), 10
                )
            self.robot.create_subscription(
                Log, "/rosout", lambda m: self.log.append(m.msg), QoSProfile(depth=1000)
            )
            self.threads.start(self.robot)
            overrides = [Parameter(name, value=value) for name, value in parameters.items()]
            self.node: Node = make(
                parameter_overrides=[Parameter("use_sim_time", value=simulated), *overrides],
            )
            if urdf:
                self.describe(urdf)
            self.threads.start(self.node)
            thread = threading.Thread(target=self._live, daemon=True)
            thread.start()
            resources.callback(join, thread)
            resources.callback(self._stopped.set)
            self._resources = resources.pop_all()

    def close(self) -> None:
        self._resources.close()

    @property
    def buffer(self) -> TransformBuffer:
        """What the node knows of the frames."""
        buffer: TransformBuffer = self.node.control._buffer
        return buffer

    @property
    def now(self) -> float:
        """The robot's time [s]."""
        return self._now

    def describe(self, urdf: str) -> None:
        self._models.publish(String(data=urdf))

    def call(self, service: str, data: bool) -> Any:
        client = self.robot.create_client(SetBool, service)
        wait_for(client.service_is_ready)
        future = client.call_async(SetBool.Request(data=data))
        wait_for(future.done)
        return future.result()

    def until(self, state: str, reason: str | None = None, *facts: str) -> None:
        """Wait for a state, its reason, and facts in the fields of `~/status`."""

        def found() -> bool:
            fields = self.fields
            said = " ".join(fields.values())
            return (
                fields.get("state") == state
                and (reason is None or fields["reason"] == reason)
                and all(fact in said for fact in facts)
            )

        try:
            wait_for(found)
        except AssertionError:
            raise AssertionError(f"{state}, {reason}, {facts} are not in {self.fields}") from None

    def until_logged(self, words: str) -> str:
        try:
            return wait_for(lambda: next((text for text in self.log if words in text), ""))
        except AssertionError:
            raise AssertionError(f"{words!r} is not in {self.log}") from None

    def farthest(self) -> float:
        """How far the head has turned since `travel` was cleared [rad]."""
        moved = list(self.travel)
        return max(max(joint) - min(joint) for joint in zip(*moved, strict=True)) if moved else 0.0

    def send(self, frame: str, point: tuple[float, float, float], stamp: float) -> None:
        message = PointStamped()
        message.header.frame_id, message.header.stamp = frame, _stamp(stamp)
        message.point = Point(x=point[0], y=point[1], z=point[2])
        self._targets.publish(message)

    def _on_status(self, message: DiagnosticStatus) -> None:
        self.fields = {each.key: each.value for each in message.values}
        self.states.append(message.message)

    def _on_command(self, message: JointState) -> None:
        self.commands += 1
        self._goals, self.speeds = list(message.position), list(message.velocity)

    def _live(self) -> None:
        start, steady, due = time.time(), time.monotonic(), 0.0
        self._now, last_target = start, 0.0
        while not self._stopped.wait(_PERIOD):
            elapsed = time.monotonic() - steady
            steady += elapsed
            if self.paused:
                start -= elapsed
            else:
                self._move(min(elapsed, 0.1))
            start += elapsed
            self._now = start + self.offset
            if self.clock_rate and steady >= due:
                due = steady + 1.0 / self.clock_rate
                self._clock.publish(Clock(clock=_stamp(self._now)))
            self.each_period()
            if self.measured:
                message = JointState(name=list(JOINTS), position=list(self.positions))
                message.header.stamp = _stamp(self._now + self.stamped_ahead)
                self._joints.publish(message)
            if self.target is not None and steady - last_target >= 0.03:
                last_target = steady
                frame, path = self.target
                self.send(frame, path(self._now), self._now)

    def _move(self, dt: float) -> None:
        for index in range(2):
            way = self._goals[index] - self.positions[index]
            self.positions[index] += math.copysign(min(abs(way), self.speeds[index] * dt), way)
        self.travel.append((self.positions[0], self.positions[1]))


def _stamp(seconds: float) -> Time:
    nanoseconds = round(seconds * 1e9)
    return Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
