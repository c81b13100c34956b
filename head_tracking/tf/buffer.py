"""The transform buffer with messages in and out, by tf2_ros's names."""

from __future__ import annotations

from geometry_msgs.msg import Point, PointStamped, TransformStamped
from rclpy.time import Time

from head_tracking.tf.conversions import (
    ns_to_stamp,
    stamp_to_ns,
    transform_from_message,
    transform_to_message,
    vector,
)
from head_tracking.transforms import TransformBuffer


class Buffer:
    """All frames over time; see :class:`head_tracking.transforms.TransformBuffer`.

    Attributes:
        core: the buffer itself, without messages.
    """

    def __init__(self, core: TransformBuffer | None = None) -> None:
        self.core = core or TransformBuffer()

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: Time
    ) -> TransformStamped:
        """The transform that takes points from source to target; ``Time()`` asks for the latest.

        Raises:
            TransformException: see `TransformBuffer.lookup_transform`.
        """
        return transform_to_message(
            self.core.lookup_transform(target_frame, source_frame, stamp_to_ns(time))
        )

    def can_transform(self, target_frame: str, source_frame: str, time: Time) -> bool:
        """Whether `lookup_transform` would answer."""
        return self.core.can_transform(target_frame, source_frame, stamp_to_ns(time))

    def transform(self, point: PointStamped, target_frame: str) -> PointStamped:
        """The point in `target_frame`, at its own stamp.

        Raises:
            TransformException: see `TransformBuffer.lookup_transform`.
        """
        found = self.core.lookup_transform(
            target_frame, point.header.frame_id, stamp_to_ns(point.header.stamp)
        )
        x, y, z = found.transform @ vector(point.point)
        result = PointStamped()
        result.header.stamp = ns_to_stamp(found.stamp)
        result.header.frame_id = target_frame
        result.point = Point(x=x, y=y, z=z)
        return result

    def set_transform(self, transform: TransformStamped, *, static: bool = False) -> None:
        """Takes a measured transform, or one that never changes.

        Raises:
            InvalidArgumentException: it makes no sense; nothing is taken.
        """
        self.core.set_transform(
            stamp_to_ns(transform.header.stamp),
            transform.header.frame_id,
            transform.child_frame_id,
            transform_from_message(transform),
            static=static,
        )

    def set_transform_static(self, transform: TransformStamped) -> None:
        """Takes a transform that never changes; see `set_transform`."""
        self.set_transform(transform, static=True)
