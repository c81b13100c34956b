"""Robots that run over real ROS topics and a simulated bus, all in this process."""

from __future__ import annotations

import gc
import math
import threading
import time
from collections.abc import Mapping
from contextlib import ExitStack, closing
from dataclasses import replace
from typing import Any

import rclpy
from geometry_msgs.msg import Point, PointStamped
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger
from waiting import failing_waits, wait_for

from head_tracking.dynamixel import Goal
from head_tracking.ros.kit.spinning import NodeThreads
from head_tracking.ros.kit.stop_signal import StopSignal
from head_tracking.run.control import Composition
from head_tracking.run.node_sets import PAGE
from head_tracking.run.options import parse_arguments


class Robot:
    """A running robot, as a person with ROS tools sees it."""

    def __init__(self, arguments: list[str], ros_args: list[str], wait: bool = True) -> None:
        with ExitStack() as resources:
            self._start(arguments, ros_args, resources)
            if wait:
                wait_for(lambda: "head_pan_joint" in self._joint_states)
            self._resources = resources.pop_all()

    def _start(self, arguments: list[str], ros_args: list[str], resources: ExitStack) -> None:
        gc.collect()  # a node that ends later takes /rosout from one of the same name
        plan = parse_arguments(arguments)
        nodes = tuple(node for node in plan.nodes if node.process != PAGE)
        plan = replace(plan, nodes=nodes)
        rclpy.init(
            args=[*plan.ros_arguments, "--ros-args", *ros_args, "--"],
            signal_handler_options=SignalHandlerOptions.NO,
        )
        resources.callback(rclpy.try_shutdown)
        servos = resources.enter_context(ExitStack())
        self.threads = resources.enter_context(closing(NodeThreads()))
        resources.enter_context(failing_waits(self.threads))
        self.composition = Composition(plan, self.threads, servos, StopSignal())
        self.simulated = self.composition.simulated
        self.node: Node = rclpy.create_node("person")
        self._lock = threading.Lock()
        self._joint_states: dict[str, float] = {}
        self._publishers: dict[str, Any] = {}
        self.received: dict[str, list[Any]] = {}
        self._log: list[str] = []
        self._read = 0
        self.node.create_subscription(Log, "/rosout", self._on_log, QoSProfile(depth=1000))
        self.node.create_subscription(JointState, "joint_states", self._on_joints, 10)
        self.threads.start(self.node)

    def close(self) -> None:
        self._resources.close()

    def _on_joints(self, message: JointState) -> None:
        with self._lock:
            self._joint_states |= zip(message.name, message.position, strict=True)

    def _on_log(self, message: Log) -> None:
        self._log.append(message.msg)

    def forget_log(self) -> None:
        """What was logged up to now counts no more."""
        self._read = len(self._log)

    def logged(self, words: str) -> str:
        """Waits for these words in the log; the message that holds them."""

        def found() -> str:
            return next((text for text in self._log[self._read :] if words in text), "")

        try:
            return wait_for(found)
        except AssertionError:
            raise AssertionError(f"{words!r} is not in {self._log[self._read :]}") from None

    def joint(self, name: str) -> float:
        """The newest position in joint_states [rad]."""
        with self._lock:
            return self._joint_states[name]

    @property
    def pan(self) -> float:
        return self.joint("head_pan_joint")

    @property
    def tilt(self) -> float:
        return self.joint("head_tilt_joint")

    def true(self, name: str) -> float:
        assert self.simulated is not None
        return self.simulated.true_position(name)

    def lead_pan(self, position: float) -> None:
        """Let a hand lead the pan joint to a position [rad] within half a second."""
        assert self.simulated is not None
        self.simulated.port.lead(1, 512 + position / math.radians(300.0 / 1024), 0.5)

    def publish(self, topic: str, message: Any) -> None:
        publisher = self._publishers.get(topic)
        if publisher is None:
            publisher = self.node.create_publisher(type(message), topic, 10)
            self._publishers[topic] = publisher
            wait_for(lambda: publisher.get_subscription_count() > 0)
        publisher.publish(message)

    def look_at(self, x: float, y: float, z: float, frame_id: str, stamp: Any = None) -> None:
        message = PointStamped(point=Point(x=float(x), y=float(y), z=float(z)))
        message.header.frame_id = frame_id
        if stamp is not None:
            message.header.stamp = stamp
        self.publish("target_point", message)

    def call(self, service: str, data: bool | None = None) -> Any:
        kind = Trigger if data is None else SetBool
        client = self.node.create_client(kind, service)
        try:
            wait_for(client.service_is_ready)
            request = kind.Request()
            if data is not None:
                request.data = data
            future = client.call_async(request)
            wait_for(future.done)
            return future.result()
        finally:
            self.node.destroy_client(client)

    def goals(self) -> list[Mapping[str, Goal]]:
        """What the run's own nodes tell the servos from now on."""
        backend, goals = self.composition.loop.backend, []
        write = backend.write

        def record(sender: str, told: Mapping[str, Goal], epoch: int) -> None:
            goals.append(told)
            write(sender, told, epoch)

        backend.write = record
        return goals

    def listen(self, topic: str, kind: Any) -> list[Any]:
        """Messages of a topic from now on."""
        messages: list[Any] = []
        self.node.create_subscription(kind, topic, messages.append, 10)
        wait_for(lambda: self.node.count_publishers(topic) > 0)
        return messages

    def at_rest(self, seconds: float = 0.3) -> tuple[float, float]:
        """Waits until the head truly stands still; where."""
        since, where = time.monotonic(), (self.pan, self.tilt)

        def still() -> bool:
            nonlocal since, where
            now = (self.true("head_pan_joint"), self.true("head_tilt_joint"))
            if any(abs(a - b) > 1e-3 for a, b in zip(now, where, strict=True)):
                since, where = time.monotonic(), now
            return time.monotonic() - since > seconds

        wait_for(still)
        return where
