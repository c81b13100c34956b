"""The transform buffer with messages in and out, by tf2_ros's names and with its arguments."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import (
    PointStamped,
    TransformStamped,
    Twist,
    Vector3,
    VelocityStamped,
)
from rclpy.clock import Clock, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.time import Time

from head_tracking.tf.async_lookups import AnyTime, AsyncLookups
from head_tracking.tf.conversions import seconds, stamp_to_ns, transform
from head_tracking.tf.messages import header, point_of, point_stamped, transform_stamped
from head_tracking.tf.tf2_messages import FrameGraph
from head_tracking.tf.transformable import TypeException, transformed
from head_tracking.transforms import TransformBuffer, TransformException
from head_tracking.transforms.history import DEFAULT_CACHE_TIME


class Buffer(AsyncLookups):
    """All frames over time; a replacement for tf2_ros.Buffer.

    ``Time()`` asks for the latest common time. With a timeout a lookup waits for what is not known
    yet; that has to come from another thread than the one that waits.

    Args:
        cache_time: how much of the past is kept; 10 s by default.
        node: for its clock: a jump back clears the buffer. Offers the service `tf2_frames` where
            tf2_msgs is installed.

    Attributes:
        core: the buffer itself, without messages.
    """

    def __init__(self, cache_time: Duration | None = None, node: Node | None = None) -> None:
        self.core = TransformBuffer(
            DEFAULT_CACHE_TIME if cache_time is None else cache_time.nanoseconds
        )
        self.clock = Clock() if node is None else node.get_clock()
        threshold = JumpThreshold(
            min_forward=None, min_backward=Duration(seconds=-1), on_clock_change=True
        )
        self.jump_handle = self.clock.create_jump_callback(threshold, post_callback=self._on_jump)
        if node is not None and FrameGraph is not None:
            self.srv = node.create_service(FrameGraph, "tf2_frames", self._on_frame_graph)

    # What is known

    def set_transform(
        self, transform: TransformStamped, authority: str = "default_authority"
    ) -> None:
        """Takes a measured transform.

        Raises:
            InvalidArgumentException: it makes no sense; nothing is taken. (tf2 only logs it.)
        """
        self._set(transform, authority, static=False)

    def set_transform_static(
        self, transform: TransformStamped, authority: str = "default_authority"
    ) -> None:
        """Takes a transform that never changes; see `set_transform`."""
        self._set(transform, authority, static=True)

    def clear(self) -> None:
        """Forgets everything recorded; static transforms and the robot model stay."""
        self.core.clear()

    # Lookups

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: AnyTime, timeout: Duration | None = None
    ) -> TransformStamped:
        """The transform that takes points from source to target.

        Raises:
            TransformException: see `TransformBuffer.lookup_transform`.
        """
        return transform_stamped(
            self.core.lookup_transform(
                target_frame, source_frame, stamp_to_ns(time), seconds(timeout)
            )
        )

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: AnyTime,
        source_frame: str,
        source_time: AnyTime,
        fixed_frame: str,
        timeout: Duration | None = None,
    ) -> TransformStamped:
        """From source at one time to target at another, through a frame that stands still.

        Raises:
            TransformException: see `TransformBuffer.lookup_transform_full`.
        """
        return transform_stamped(
            self.core.lookup_transform_full(
                target_frame,
                stamp_to_ns(target_time),
                source_frame,
                stamp_to_ns(source_time),
                fixed_frame,
                seconds(timeout),
            )
        )

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: AnyTime,
        timeout: Duration | None = None,
        return_debug_tuple: bool = False,
    ) -> bool | tuple[bool, str]:
        """Whether `lookup_transform` would answer; with the reason if `return_debug_tuple`."""
        reason = self.core.why_not(target_frame, source_frame, stamp_to_ns(time), seconds(timeout))
        return (not reason, reason) if return_debug_tuple else not reason

    def can_transform_full(
        self,
        target_frame: str,
        target_time: AnyTime,
        source_frame: str,
        source_time: AnyTime,
        fixed_frame: str,
        timeout: Duration | None = None,
        return_debug_tuple: bool = False,
    ) -> bool | tuple[bool, str]:
        """Whether `lookup_transform_full` would answer; see `can_transform`."""
        reason = ""
        try:
            self.lookup_transform_full(
                target_frame, target_time, source_frame, source_time, fixed_frame, timeout
            )
        except TransformException as error:
            reason = str(error)
        return (not reason, reason) if return_debug_tuple else not reason

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Time:
        """The newest time at which both frames are known; zero if nothing ever changes.

        Raises:
            TransformException: there is none.
        """
        return Time(nanoseconds=self.core.get_latest_common_time(target_frame, source_frame))

    def lookup_velocity(
        self,
        tracking_frame: str,
        observation_frame: str,
        time: AnyTime,
        averaging_interval: Duration,
    ) -> VelocityStamped:
        """How a frame moves as seen from another; see `TransformBuffer.lookup_velocity`.

        Raises:
            TransformException: it is not known.
        """
        found = self.core.lookup_velocity(
            tracking_frame,
            observation_frame,
            stamp_to_ns(time),
            averaging_interval.nanoseconds,
        )
        linear, angular = (Vector3(x=x, y=y, z=z) for x, y, z in (found.linear, found.angular))
        return VelocityStamped(
            header=header(found.stamp, found.reference_frame),
            body_frame_id=found.body_frame,
            reference_frame_id=found.reference_frame,
            velocity=Twist(linear=linear, angular=angular),
        )

    def transform(
        self,
        object_stamped: Any,
        target_frame: str,
        timeout: Duration | None = None,
        new_type: type | None = None,
    ) -> Any:
        """A stamped message in `target_frame`, at its own stamp.

        PointStamped, Vector3Stamped, PoseStamped, PoseWithCovarianceStamped, QuaternionStamped
        and TransformStamped.

        Raises:
            TypeException: another message, or a `new_type` that is not its own.
            TransformException: see `lookup_transform`.
        """
        if type(object_stamped) is PointStamped and timeout is None and new_type is None:
            stamp, frame_id, point = point_of(object_stamped)
            return point_stamped(
                target_frame, self.core.locate(point, target_frame, frame_id, stamp)
            )
        _check_type(object_stamped, new_type)
        at = object_stamped.header
        return transformed(
            object_stamped,
            self.core.lookup_transform(
                target_frame, at.frame_id, stamp_to_ns(at.stamp), seconds(timeout)
            ),
        )

    def transform_full(
        self,
        object_stamped: Any,
        target_frame: str,
        target_time: AnyTime,
        fixed_frame: str,
        timeout: Duration | None = None,
        new_type: type | None = None,
    ) -> Any:
        """A stamped message in `target_frame` at another time; see `transform`.

        Raises:
            TypeException: another message, or a `new_type` that is not its own.
            TransformException: see `lookup_transform_full`.
        """
        _check_type(object_stamped, new_type)
        at = object_stamped.header
        found = self.core.lookup_transform_full(
            target_frame,
            stamp_to_ns(target_time),
            at.frame_id,
            stamp_to_ns(at.stamp),
            fixed_frame,
            seconds(timeout),
        )
        return transformed(object_stamped, found)

    # Looking at it

    def all_frames_as_string(self) -> str:
        """A sentence a frame."""
        return self.core.all_frames_as_string()

    def all_frames_as_yaml(self) -> str:
        """What is known of each frame."""
        return self.core.all_frames_as_yaml()

    # Inside

    def _set(self, message: TransformStamped, authority: str, *, static: bool) -> None:
        self.core.set_transform(
            stamp_to_ns(message.header.stamp),
            message.header.frame_id,
            message.child_frame_id,
            transform(message),
            static=static,
            authority=authority,
        )

    def _on_jump(self, _: TimeJump) -> None:
        get_logger("head_tracking.tf").warning("time jumped back: the transform buffer is cleared")
        self.clear()

    def _on_frame_graph(self, _: Any, response: Any) -> Any:
        response.frame_yaml = self.all_frames_as_yaml()
        return response


def _check_type(message: Any, new_type: type | None) -> None:
    if new_type is not None and new_type is not type(message):
        raise TypeException(
            f"a {type(message).__name__} cannot become a {new_type.__name__}; leave new_type out"
        )
