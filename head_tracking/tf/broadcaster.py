"""Sends transforms to other programs, on `/tf` and `/tf_static`; needs tf2_msgs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile

from head_tracking.ros.kit.qos import LATCHED, TF
from head_tracking.tf.tf2_messages import TFMessage, require_tf2_msgs

Transforms: TypeAlias = TransformStamped | Iterable[TransformStamped]


def broadcasting_possible() -> bool:
    """Whether tf2_msgs is installed; it is not among the ROS wheels."""
    return TFMessage is not None


class TransformBroadcaster:
    """Sends measured transforms.

    Args:
        node: sends.
        qos: of `/tf`.

    Raises:
        ImportError: tf2_msgs is not installed.
    """

    def __init__(self, node: Node, qos: QoSProfile | int | None = None) -> None:
        require_tf2_msgs()
        self.pub_tf = node.create_publisher(TFMessage, "/tf", TF if qos is None else qos)

    def sendTransform(self, transform: Transforms) -> None:
        """Sends one transform or several."""
        self.pub_tf.publish(TFMessage(transforms=_listed(transform)))


class StaticTransformBroadcaster:
    """Sends transforms that never change; who comes later gets all of them.

    Args:
        node: sends.
        qos: of `/tf_static`.

    Raises:
        ImportError: tf2_msgs is not installed.
    """

    def __init__(self, node: Node, qos: QoSProfile | int | None = None) -> None:
        require_tf2_msgs()
        self.pub_tf = node.create_publisher(
            TFMessage, "/tf_static", LATCHED if qos is None else qos
        )
        self._sent: dict[str, TransformStamped] = {}

    def sendTransform(self, transform: Transforms) -> None:
        """Sends one transform or several, with all those sent before."""
        self._sent |= {sent.child_frame_id: sent for sent in _listed(transform)}
        self.pub_tf.publish(TFMessage(transforms=list(self._sent.values())))

    def forget(self) -> None:
        """The transforms sent so far are not sent again, as after another robot model."""
        self._sent.clear()


def _listed(transforms: Transforms) -> list[TransformStamped]:
    return [transforms] if isinstance(transforms, TransformStamped) else list(transforms)
