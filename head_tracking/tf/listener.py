"""Feeds a buffer from the robot's topics."""

from __future__ import annotations

import threading
from collections.abc import Callable

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from head_tracking.tf.buffer import Buffer
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.tf.qos import LATCHED, MEASUREMENT, TF, TF_STATIC
from head_tracking.tf.tf2_messages import TFMessage
from head_tracking.transforms import (
    InvalidArgumentException,
    RobotModelError,
    parse_robot_model,
)


class TransformListener:
    """Listens on `robot_description` and `joint_states`; and on `/tf` where tf2_msgs exists.

    The frames of the robot are computed from its joints when somebody asks; nothing is broadcast
    or stored per frame. A bad message is reported and changes nothing.

    Args:
        buffer: to be fed.
        node: listens; its executor must spin. None: a node of its own in a thread of its own.
        spin_thread: listen in a thread of its own, however `node` spins.
        qos: of `/tf`.
        static_qos: of `/tf_static`.
        tf_topic: instead of `/tf`.
        tf_static_topic: instead of `/tf_static`.
        static_only: listen on `/tf_static` only.
        frame_prefix: put before the names of the robot's links.
        on_joints: called with every message of `joint_states` that the buffer has taken.
    """

    def __init__(
        self,
        buffer: Buffer,
        node: Node | None = None,
        *,
        spin_thread: bool = False,
        qos: QoSProfile | int | None = None,
        static_qos: QoSProfile | int | None = None,
        tf_topic: str = "/tf",
        tf_static_topic: str = "/tf_static",
        static_only: bool = False,
        frame_prefix: str = "",
        on_joints: Callable[[JointState], object] = lambda _: None,
    ) -> None:
        self.buffer = buffer
        self._prefix = frame_prefix
        self._joints_taken = on_joints
        self._thread: threading.Thread | None = None
        self._stopped = threading.Event()
        self.node = _own_node(self, node) if node is None or spin_thread else node
        self._log = self.node.get_logger()
        # waiting for a transform in one callback must not keep the others from bringing it
        group = ReentrantCallbackGroup()
        wanted = []
        if not static_only:
            wanted += [
                (String, "robot_description", self._on_description, LATCHED),
                (JointState, "joint_states", self._on_joints, MEASUREMENT),
            ]
        if TFMessage is not None:
            wanted.append((TFMessage, tf_static_topic, self._on_static, static_qos or TF_STATIC))
            if not static_only:
                wanted.append((TFMessage, tf_topic, self._on_transforms, qos or TF))
        self._subscriptions = [
            self.node.create_subscription(kind, topic, callback, profile, callback_group=group)
            for kind, topic, callback, profile in wanted
        ]
        if self.node is not node:
            self._thread = threading.Thread(
                target=self._spin, name="transform listener", daemon=True
            )
            self._thread.start()

    def unregister(self) -> None:
        """Stops listening."""
        self._stopped.set()
        if self._thread is not None:
            self._thread.join()
        for subscription in self._subscriptions:
            self.node.destroy_subscription(subscription)
        self._subscriptions = []
        if self._thread is not None:
            self.node.destroy_node()

    def _spin(self) -> None:
        executor = SingleThreadedExecutor(context=self.node.context)
        executor.add_node(self.node)
        while not self._stopped.is_set() and self.node.context.ok():
            executor.spin_once(timeout_sec=0.1)
        executor.shutdown()

    def _on_description(self, message: String) -> None:
        model = self.buffer.core.model
        if model is not None and model.urdf == message.data:
            return
        try:
            model = parse_robot_model(message.data)
        except RobotModelError as error:
            self._log.error(f"robot_description is not used: {error}")
            return
        self.buffer.core.set_model(model.prefixed(self._prefix))

    def _on_joints(self, message: JointState) -> None:
        try:
            self.buffer.core.set_joint_positions(
                stamp_to_ns(message.header.stamp),
                dict(zip(message.name, message.position, strict=False)),
            )
        except InvalidArgumentException as error:
            self._log.error(f"joint_states: {error}", throttle_duration_sec=1.0)
        else:
            self._joints_taken(message)

    def _on_transforms(self, message: TFMessage) -> None:
        for transform in message.transforms:
            try:
                self.buffer.set_transform(transform)
            except InvalidArgumentException as error:
                self._log.error(f"/tf: {error}", throttle_duration_sec=1.0)

    def _on_static(self, message: TFMessage) -> None:
        for transform in message.transforms:
            try:
                self.buffer.set_transform_static(transform)
            except InvalidArgumentException as error:
                self._log.error(f"/tf_static: {error}", throttle_duration_sec=1.0)


def listening_buffer(node: Node) -> Buffer:
    """A buffer on a node's clock, fed by what the node hears; its executor must spin."""
    buffer = Buffer(node=node)
    TransformListener(buffer, node)
    return buffer


def _own_node(listener: TransformListener, node: Node | None) -> Node:
    return Node(
        f"transform_listener_impl_{id(listener):x}",
        namespace=None if node is None else node.get_namespace(),
        context=None if node is None else node.context,
        enable_rosout=False,
        start_parameter_services=False,
        use_global_arguments=False,
        parameter_overrides=[Parameter("use_sim_time", value=False)],
    )
