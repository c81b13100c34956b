"""`head_tracking.transforms` for ROS messages, with the names and arguments of tf2_ros."""

from head_tracking.tf.broadcaster import (
    StaticTransformBroadcaster,
    TransformBroadcaster,
    broadcasting_possible,
)
from head_tracking.tf.buffer import Buffer, BufferCore, BufferInterface
from head_tracking.tf.do_transform import (
    do_transform_cloud,
    do_transform_point,
    do_transform_polygon_stamped,
    do_transform_pose,
    do_transform_pose_stamped,
    do_transform_pose_with_covariance_stamped,
    do_transform_vector3,
    from_msg_msg,
    to_msg_msg,
    transform_covariance,
    transform_points,
)
from head_tracking.tf.listener import (
    DEFAULT_STATIC_TF_TOPIC,
    DEFAULT_TF_TOPIC,
    StaticTransformListener,
    TransformListener,
    listening_buffer,
)
from head_tracking.tf.registration import (
    ConvertRegistration,
    Stamped,
    TransformRegistration,
    TypeException,
    convert,
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
    "ConvertRegistration",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "Stamped",
    "StaticTransformBroadcaster",
    "StaticTransformListener",
    "TimeoutException",
    "TransformBroadcaster",
    "TransformException",
    "TransformListener",
    "TransformRegistration",
    "TypeException",
    "broadcasting_possible",
    "convert",
    "do_transform_cloud",
    "do_transform_point",
    "do_transform_polygon_stamped",
    "do_transform_pose",
    "do_transform_pose_stamped",
    "do_transform_pose_with_covariance_stamped",
    "do_transform_vector3",
    "from_msg_msg",
    "listening_buffer",
    "to_msg_msg",
    "transform_covariance",
    "transform_points",
]
