"""Fills a buffer from the topics of a robot."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from head_tracking.parameters import parameter
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.threads import NodeThread
from head_tracking.ros.kit.topics import LATCHED, LONGEST_TEXT, MEASUREMENT, TF, TF_STATIC
from head_tracking.tf.buffer import Buffer
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.tf.messages import TFMessage
from head_tracking.transforms import (
    InvalidArgumentException,
    RobotModelError,
    TransformBuffer,
    parse_robot_model,
)

DEFAULT_TF_TOPIC = "/tf"
DEFAULT_STATIC_TF_TOPIC = "/tf_static"

CLOCK_JUMP = 1_000_000_000
"""A joint older than its latest position by this [ns] is late, or the clock has jumped back."""


class TransformListener:
    """Subscribes to `robot_description` and `joint_states`; to `/tf` where tf2_msgs is installed.

    The frames of the robot are computed from its joints in a lookup. An invalid message is logged
    and changes nothing.

    Args:
        buffer: is filled. A buffer of another package, such as tf2_ros, receives `/tf` only, and so
            does one in which another listener has another robot, by topic or prefix.
        node: subscribes; an executor must spin it. None: a node and a thread of its own.
        spin_thread: spin the node, with all its callbacks, in a thread of its own.
        qos: of `/tf`.
        static_qos: of `/tf_static`.
        tf_topic: instead of `/tf`.
        tf_static_topic: instead of `/tf_static`.
        static_only: subscribe to `/tf_static` only.
        frame_prefix: put before the names of the robot's links.
        on_joints: called with each message of `joint_states`, once the buffer has its positions.

    Attributes:
        tf_sub: the subscription of `/tf`; tf_static_sub: that of `/tf_static`.
        executor: spins the node in `dedicated_listener_thread`, if there is one.
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
        self.node = node or _own_node(self)
        self._prefix = frame_prefix
        self._joints_accepted = on_joints
        self._log = self.node.get_logger()
        # a callback that waits for a transform must not block the callbacks that bring it
        self.group = ReentrantCallbackGroup()
        self._subscriptions: list[Any] = []
        self._robot = self.node.resolve_topic_name("robot_description"), frame_prefix
        self._fills_robot = False
        core = getattr(buffer, "core", None)
        if isinstance(core, TransformBuffer) and not static_only:
            self._core = core
            self._fills_robot = set(buffer.robots) <= {self._robot}
            if self._fills_robot:
                buffer.robots.append(self._robot)
                self._subscribe(String, "robot_description", self._on_description, LATCHED)
                self._subscribe(JointState, "joint_states", self._on_joints, MEASUREMENT)
            else:
                self._log.warning(
                    f"the buffer computes the robot of {' '.join(buffer.robots[0])}; the one of "
                    f"{' '.join(self._robot)} is received from {tf_topic} only"
                )
        if TFMessage is not None:
            if not static_only:
                self.tf_sub = self._subscribe(TFMessage, tf_topic, self.callback, qos or TF)
            self.tf_static_sub = self._subscribe(
                TFMessage, tf_static_topic, self.static_callback, static_qos or TF_STATIC
            )
        self._own_thread: NodeThread | None = None
        if spin_thread or node is None:
            self._own_thread = NodeThread(self.node, owns_node=node is None)
            self.executor = self._own_thread.executor
            self.dedicated_listener_thread = self._own_thread.thread
            self._own_thread.start()

    def unregister(self) -> None:
        """Unsubscribe from all topics; may be called twice."""
        if self._own_thread is not None:
            self._own_thread.close()
        if self._fills_robot:
            self.buffer.robots.remove(self._robot)
            self._fills_robot = False
        while self._subscriptions:
            self.node.destroy_subscription(self._subscriptions.pop())

    def callback(self, data: Any) -> None:
        """Accept a message of `/tf`."""
        self._accept("/tf", data, self.buffer.set_transform)

    def static_callback(self, data: Any) -> None:
        """Accept a message of `/tf_static`."""
        self._accept("/tf_static", data, self.buffer.set_transform_static)

    def _accept(self, topic: str, data: Any, record: Callable[[Any, str], object]) -> None:
        for transform in data.transforms:
            try:
                record(transform, "default_authority")
            except InvalidArgumentException as error:
                text = f"{topic}: {error}"[:LONGEST_TEXT]
                self._log.error(text, throttle_duration_sec=1.0)

    def _on_description(self, message: String) -> None:
        model = self._core.model
        if model is not None and model.urdf == message.data:
            return
        try:
            model = parse_robot_model(message.data)
        except RobotModelError as error:
            text = f"robot_description is ignored: {error}"[:LONGEST_TEXT]
            self._log.error(text, throttle_duration_sec=1.0)
            return
        self._core.set_model(model.prefixed(self._prefix))

    def _on_joints(self, message: JointState) -> None:
        names, positions = message.name, message.position
        if len(names) != len(positions):
            if positions:
                self._log.error(
                    f"joint_states has {len(names)} names and {len(positions)} positions; one "
                    "position for each name is needed",
                    throttle_duration_sec=1.0,
                )
            return
        stamp = stamp_to_ns(message.header.stamp)
        # of these joints: the clock of another publisher may be ahead
        samples = map(self._core.latest_joint_position, names)
        latest = max((sample[0] for sample in samples if sample is not None), default=0)
        if stamp < latest - CLOCK_JUMP:
            now = self.node.get_clock().now().nanoseconds
            if now < latest:  # else the message is late
                text = "time jumped back: the transform buffer is cleared"
                self._log.warning(text, throttle_duration_sec=1.0)
                self._core.clear()
        # ros2_control publishes NaN for joints whose position is not measured, such as wheels
        pairs = zip(names, positions, strict=True)
        measured = {name: position for name, position in pairs if not math.isnan(position)}
        try:
            self._core.set_joint_positions(stamp, measured)
        except InvalidArgumentException as error:  # the other joints are recorded
            text = f"joint_states: {error}"[:LONGEST_TEXT]
            self._log.error(text, throttle_duration_sec=1.0)
        self._joints_accepted(message)

    def _subscribe(
        self, kind: type, topic: str, callback: Callable[[Any], None], qos: QoSProfile | int
    ) -> Any:
        subscription = self.node.create_subscription(
            kind, topic, callback, qos, callback_group=self.group
        )
        self._subscriptions.append(subscription)
        return subscription


class StaticTransformListener(TransformListener):
    """Subscribes to `/tf_static` only; see `TransformListener`."""

    def __init__(self, buffer: Buffer, node: Node | None = None, **options: Any) -> None:
        super().__init__(buffer, node, static_only=True, **options)


@dataclass(frozen=True, slots=True)
class PrefixParameters:
    """The parameter of a node that listens."""

    frame_prefix: str = parameter(
        "", "Put before the names of the robot's links, as by robot_state_publisher.", fixed=True
    )


def listening_buffer(
    node: Node,
    subscriber: Node | None = None,
    on_joints: Callable[[JointState], object] = lambda _: None,
) -> Buffer:
    """Return a buffer on a node's clock, filled by its subscriptions; an executor must spin it.

    Args:
        node: declares the parameter `frame_prefix`.
        subscriber: subscribes instead of the node.
        on_joints: see `TransformListener`.
    """
    buffer = Buffer(node=node)
    TransformListener(buffer, subscriber or node, frame_prefix=prefix_of(node), on_joints=on_joints)
    return buffer


def prefix_of(node: Node) -> str:
    """Declare the parameter `frame_prefix` of a node that listens, and return its value."""
    return NodeParameters(node, PrefixParameters).value.frame_prefix


def _own_node(listener: TransformListener) -> Node:
    return Node(
        f"transform_listener_impl_{id(listener):x}",
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[Parameter("use_sim_time", value=False)],
    )
