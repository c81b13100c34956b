"""Feeds a buffer from the robot's topics."""

from __future__ import annotations

import atexit
import contextlib
import threading
import time
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from head_tracking.ros.kit.qos import LATCHED, MEASUREMENT, TF, TF_STATIC
from head_tracking.tf.buffer import Buffer
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.tf.tf2_messages import TFMessage
from head_tracking.transforms import (
    InvalidArgumentException,
    RobotModelError,
    TransformBuffer,
    parse_robot_model,
)

DEFAULT_TF_TOPIC = "/tf"
DEFAULT_STATIC_TF_TOPIC = "/tf_static"

CLOCK_JUMP = 1_000_000_000
"""Joint states farther back than this [ns] are late, or their clock jumped."""
PATIENCE = 2.0
"""So long is a callback waited for when the program ends [s]."""


class TransformListener:
    """Listens on `robot_description` and `joint_states`; and on `/tf` where tf2_msgs exists.

    The frames of the robot are computed from its joints when somebody asks; nothing is broadcast
    or stored per frame. A bad message is reported and changes nothing.

    Args:
        buffer: to be fed; one that is not this package's, tf2_ros's for example, gets `/tf` only.
        node: listens; its executor must spin. None: a node of its own in a thread of its own.
        spin_thread: spin the node in a thread of its own, with all of its callbacks.
        qos: of `/tf`.
        static_qos: of `/tf_static`.
        tf_topic: instead of `/tf`.
        tf_static_topic: instead of `/tf_static`.
        static_only: listen on `/tf_static` only.
        frame_prefix: put before the names of the robot's links.
        on_joints: called with every message of `joint_states` that the buffer has taken.

    Attributes:
        tf_sub: the subscription of `/tf`; tf_static_sub: that of `/tf_static`.
        executor: what spins the node, and dedicated_listener_thread: where, if this is asked for.
    """

    def __init__(
        self,
        buffer: Buffer,
        node: Node | None = None,
        *,
        spin_thread: bool = False,
        qos: QoSProfile | int | None = None,
        static_qos: QoSProfile | int | None = None,
        tf_topic: str = DEFAULT_TF_TOPIC,
        tf_static_topic: str = DEFAULT_STATIC_TF_TOPIC,
        static_only: bool = False,
        frame_prefix: str = "",
        on_joints: Callable[[JointState], object] = lambda _: None,
    ) -> None:
        self.buffer = buffer
        self._prefix = frame_prefix
        self._joints_taken = on_joints
        self._newest = 0
        self._own_node = node is None
        self.node = node or _own_node(self)
        self._log = self.node.get_logger()
        # waiting for a transform in one callback must not keep the others from bringing it
        self.group = ReentrantCallbackGroup()
        self._subscriptions: list[Any] = []
        core = getattr(buffer, "core", None)
        if isinstance(core, TransformBuffer) and not static_only:
            self._core = core
            self._listen(String, "robot_description", self._on_description, LATCHED)
            self._listen(JointState, "joint_states", self._on_joints, MEASUREMENT)
        if TFMessage is not None:
            if not static_only:
                self.tf_sub = self._listen(TFMessage, tf_topic, self.callback, qos or TF)
            self.tf_static_sub = self._listen(
                TFMessage, tf_static_topic, self.static_callback, static_qos or TF_STATIC
            )
        self._clock_watch = _watch_clock(self.node)
        self.dedicated_listener_thread: threading.Thread | None = None
        if spin_thread or self._own_node:
            self._stopped = threading.Event()
            self.executor = SingleThreadedExecutor(context=self.node.context)
            self.executor.add_node(self.node)
            self.dedicated_listener_thread = threading.Thread(
                target=self._spin, name="transform listener", daemon=True
            )
            self.dedicated_listener_thread.start()
            # a thread inside rclpy when the interpreter goes would abort the process
            atexit.register(self._stop)

    def unregister(self) -> None:
        """Stops listening."""
        self._stop()
        for subscription in self._subscriptions:
            self.node.destroy_subscription(subscription)
        self._subscriptions.clear()
        if self._clock_watch is not None:
            self.node.destroy_timer(self._clock_watch)
            self._clock_watch = None
        if self._own_node:
            self.node.destroy_node()

    def callback(self, data: Any) -> None:
        """Takes a message of `/tf`."""
        self._take("/tf", data, self.buffer.set_transform)

    def static_callback(self, data: Any) -> None:
        """Takes a message of `/tf_static`."""
        self._take("/tf_static", data, self.buffer.set_transform_static)

    def _take(self, topic: str, data: Any, put: Callable[[Any, str], object]) -> None:
        for transform in data.transforms:
            try:
                put(transform, "default_authority")
            except InvalidArgumentException as error:
                self._log.error(f"{topic}: {error}", throttle_duration_sec=1.0)

    def _on_description(self, message: String) -> None:
        model = self._core.model
        if model is not None and model.urdf == message.data:
            return
        try:
            model = parse_robot_model(message.data)
        except RobotModelError as error:
            self._log.error(f"robot_description is not used: {error}")
            return
        self._core.set_model(model.prefixed(self._prefix))

    def _on_joints(self, message: JointState) -> None:
        names, positions = message.name, message.position
        if len(names) != len(positions):
            if positions:
                self._log.error(
                    f"joint_states: {len(names)} names and {len(positions)} positions; there must "
                    "be one position for each name",
                    throttle_duration_sec=1.0,
                )
            return
        stamp = stamp_to_ns(message.header.stamp)
        if stamp < self._newest - CLOCK_JUMP:
            self._start_anew(stamp)
        self._newest = max(stamp, self._newest)
        try:
            self._core.set_joint_positions(stamp, dict(zip(names, positions, strict=True)))
        except InvalidArgumentException as error:
            self._log.error(f"joint_states: {error}", throttle_duration_sec=1.0)
        else:
            self._joints_taken(message)

    def _start_anew(self, stamp: int) -> None:
        """Forgets what a clock stamped that has jumped back since; not for a late message."""
        if self.node.get_clock().now().nanoseconds < self._newest:
            self._log.warning("time jumped back: the transform buffer is cleared")
            self._core.clear()
            self._newest = stamp

    def _listen(
        self, kind: type, topic: str, callback: Callable[[Any], None], qos: QoSProfile | int
    ) -> Any:
        subscription = self.node.create_subscription(
            kind, topic, callback, qos, callback_group=self.group
        )
        self._subscriptions.append(subscription)
        return subscription

    def _spin(self) -> None:
        while not self._stopped.is_set() and self.node.context.ok():
            try:
                self.executor.spin_once(timeout_sec=0.1)
            except Exception as error:  # whatever a callback of the node's owner may raise
                if not self._stopped.is_set() and self.node.context.ok():
                    self._log.error(f"a callback of {self.node.get_name()} failed: {error!r}")
                    time.sleep(0.01)

    def _stop(self) -> None:
        """Ends the thread; at the end of the program however it ends."""
        thread = self.dedicated_listener_thread
        if thread is None or thread is threading.current_thread() or self._stopped.is_set():
            return
        atexit.unregister(self._stop)
        self._stopped.set()
        self.executor.wake()
        deadline = time.monotonic() + PATIENCE
        while thread.is_alive() and (left := deadline - time.monotonic()) > 0.0:
            with contextlib.suppress(KeyboardInterrupt):  # an impatient second Ctrl-C
                thread.join(left)
        if not thread.is_alive():
            self.executor.remove_node(self.node)
            self.executor.shutdown()


class StaticTransformListener(TransformListener):
    """Listens on `/tf_static` only; else as `TransformListener`."""

    def __init__(self, buffer: Buffer, node: Node | None = None, **options: Any) -> None:
        super().__init__(buffer, node, static_only=True, **options)


def listening_buffer(node: Node) -> Buffer:
    """A buffer on a node's clock, fed by what the node hears; its executor must spin."""
    buffer = Buffer(node=node)
    TransformListener(buffer, node)
    return buffer


def _own_node(listener: TransformListener) -> Node:
    return Node(
        f"transform_listener_impl_{id(listener):x}",
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[Parameter("use_sim_time", value=False)],
    )


def _watch_clock(node: Node) -> Any:
    """Says so if a node takes the time from /clock and nobody sends it: nothing would ever move."""
    clock = node.get_clock()
    if not clock.ros_time_is_active:
        return None

    def look() -> None:
        if clock.now().nanoseconds:
            watch.cancel()
        else:
            node.get_logger().warning(
                "use_sim_time is set, and there is no time on /clock yet: time stands still and "
                "nothing moves; start what sends /clock, or set use_sim_time to false"
            )

    watch = node.create_timer(5.0, look, clock=Clock(clock_type=ClockType.STEADY_TIME))
    return watch
