"""Publishers of transforms on `/tf` and `/tf_static`; they need tf2_msgs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile

from head_tracking.ros.kit.topics import LATCHED, TF
from head_tracking.tf.messages import TFMessage

Transforms: TypeAlias = TransformStamped | Iterable[TransformStamped]


def broadcasting_possible() -> bool:
    """Return whether tf2_msgs is installed; it is not among the ROS wheels."""
    return TFMessage is not None


class TransformBroadcaster:
    """Publishes measured transforms.

    Raises:
        ImportError: tf2_msgs is not installed.
    """

    _TOPIC, _QOS = "/tf", TF

    def __init__(self, node: Node, qos: QoSProfile | int | None = None) -> None:
        if TFMessage is None:
            raise ImportError(
                "tf2_msgs is not installed; it comes with a ROS 2 installation (ros-jazzy-tf2-msgs)"
            )
        self.pub_tf = node.create_publisher(
            TFMessage, self._TOPIC, self._QOS if qos is None else qos
        )

    def sendTransform(self, transform: Transforms) -> None:
        """Publish one transform or several."""
        self.pub_tf.publish(TFMessage(transforms=_listed(transform)))


class StaticTransformBroadcaster(TransformBroadcaster):
    """Publishes transforms that never change; later subscribers receive all of them."""

    _TOPIC, _QOS = "/tf_static", LATCHED

    def __init__(self, node: Node, qos: QoSProfile | int | None = None) -> None:
        super().__init__(node, qos)
        self._sent: dict[str, TransformStamped] = {}

    def sendTransform(self, transform: Transforms) -> None:
        """Publish one transform or several, and again all those sent before."""
        self._sent |= {sent.child_frame_id: sent for sent in _listed(transform)}
        super().sendTransform(self._sent.values())

    def forget(self) -> None:
        """Do not send the transforms so far again, for example with another robot model."""
        self._sent.clear()


def _listed(transforms: Transforms) -> list[TransformStamped]:
    return [transforms] if isinstance(transforms, TransformStamped) else list(transforms)
