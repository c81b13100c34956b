"""`head_tracking.transforms` for ROS messages, with the names and arguments of tf2_ros."""

from head_tracking.tf.broadcaster import (
    StaticTransformBroadcaster,
    TransformBroadcaster,
    broadcasting_possible,
)
from head_tracking.tf.buffer import Buffer, BufferCore, BufferInterface
from head_tracking.tf.do_transform import (
    TransformRegistration,
    TypeException,
    do_transform_point,
    do_transform_pose,
    do_transform_pose_stamped,
    do_transform_pose_with_covariance_stamped,
    do_transform_vector3,
)
from head_tracking.tf.listener import (
    DEFAULT_STATIC_TF_TOPIC,
    DEFAULT_TF_TOPIC,
    StaticTransformListener,
    TransformListener,
    listening_buffer,
    prefix_of,
)
from head_tracking.transforms.exceptions import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)

__all__ = [
    "DEFAULT_STATIC_TF_TOPIC",
    "DEFAULT_TF_TOPIC",
    "Buffer",
    "BufferCore",
    "BufferInterface",
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "StaticTransformBroadcaster",
    "StaticTransformListener",
    "TimeoutException",
    "TransformBroadcaster",
    "TransformException",
    "TransformListener",
    "TransformRegistration",
    "TypeException",
    "broadcasting_possible",
    "do_transform_point",
    "do_transform_pose",
    "do_transform_pose_stamped",
    "do_transform_pose_with_covariance_stamped",
    "do_transform_vector3",
    "listening_buffer",
    "prefix_of",
]
