"""Sends transforms to other programs, on `/tf` and `/tf_static`; needs tf2_msgs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node

from head_tracking.tf.qos import TF, TF_STATIC
from head_tracking.tf.tf2_messages import TFMessage

Transforms: TypeAlias = TransformStamped | Iterable[TransformStamped]


def broadcasting_possible() -> bool:
    """Whether tf2_msgs is installed; it is not among the ROS wheels."""
    return TFMessage is not None


class TransformBroadcaster:
    """Sends measured transforms.

    Raises:
        ImportError: tf2_msgs is not installed.
    """

    def __init__(self, node: Node) -> None:
        _require_tf2_msgs()
        self._publisher = node.create_publisher(TFMessage, "/tf", TF)

    def sendTransform(self, transforms: Transforms) -> None:
        """Sends one transform or several."""
        self._publisher.publish(TFMessage(transforms=_listed(transforms)))


class StaticTransformBroadcaster:
    """Sends transforms that never change; who comes later gets all of them.

    Raises:
        ImportError: tf2_msgs is not installed.
    """

    def __init__(self, node: Node) -> None:
        _require_tf2_msgs()
        self._publisher = node.create_publisher(TFMessage, "/tf_static", TF_STATIC)
        self._sent: dict[str, TransformStamped] = {}

    def sendTransform(self, transforms: Transforms) -> None:
        """Sends one transform or several, with all those sent before."""
        self._sent |= {transform.child_frame_id: transform for transform in _listed(transforms)}
        self._publisher.publish(TFMessage(transforms=list(self._sent.values())))


def _listed(transforms: Transforms) -> list[TransformStamped]:
    return [transforms] if isinstance(transforms, TransformStamped) else list(transforms)


def _require_tf2_msgs() -> None:
    if not broadcasting_possible():
        raise ImportError(
            "tf2_msgs is not installed, so nothing can be sent on /tf; it comes with a ROS 2 "
            "installation (ros-jazzy-tf2-msgs)"
        )
