"""The ROS face of `head_tracking.transforms`: tf2_ros's names and words, messages in and out."""

from head_tracking.tf.broadcaster import (
    StaticTransformBroadcaster,
    TransformBroadcaster,
    broadcasting_possible,
)
from head_tracking.tf.buffer import Buffer
from head_tracking.tf.listener import TransformListener, listening_buffer
from head_tracking.tf.transformable import TypeException
from head_tracking.transforms.exceptions import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)

__all__ = [
    "Buffer",
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "StaticTransformBroadcaster",
    "TimeoutException",
    "TransformBroadcaster",
    "TransformException",
    "TransformListener",
    "TypeException",
    "broadcasting_possible",
    "listening_buffer",
]
