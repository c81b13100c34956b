"""Feeds a buffer from the robot's topics."""

from __future__ import annotations

from rclpy.node import Node
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

    The frames of the robot are computed from its joints when somebody asks; nothing is
    broadcast or stored per frame. A bad message is reported and changes nothing.
    """

    def __init__(self, buffer: Buffer, node: Node) -> None:
        self._buffer = buffer
        self._log = node.get_logger()
        node.create_subscription(String, "robot_description", self._on_description, LATCHED)
        node.create_subscription(JointState, "joint_states", self._on_joints, MEASUREMENT)
        if TFMessage is not None:
            node.create_subscription(TFMessage, "/tf", self._on_transforms, TF)
            node.create_subscription(TFMessage, "/tf_static", self._on_static, TF_STATIC)

    def _on_description(self, message: String) -> None:
        model = self._buffer.core.model
        if model is not None and model.urdf == message.data:
            return
        try:
            self._buffer.core.set_model(parse_robot_model(message.data))
        except RobotModelError as error:
            self._log.error(f"robot_description is not used: {error}")

    def _on_joints(self, message: JointState) -> None:
        try:
            self._buffer.core.set_joint_positions(
                stamp_to_ns(message.header.stamp),
                dict(zip(message.name, message.position, strict=False)),
            )
        except InvalidArgumentException as error:
            self._log.error(f"joint_states: {error}", throttle_duration_sec=1.0)

    def _on_transforms(self, message: TFMessage, *, static: bool = False) -> None:
        for transform in message.transforms:
            try:
                self._buffer.set_transform(transform, static=static)
            except InvalidArgumentException as error:
                self._log.error(f"/tf: {error}", throttle_duration_sec=1.0)

    def _on_static(self, message: TFMessage) -> None:
        self._on_transforms(message, static=True)
