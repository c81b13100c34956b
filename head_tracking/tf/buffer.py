"""The transform buffer with messages in and out, by tf2_ros's names and with its arguments."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import TransformStamped, Twist, VelocityStamped
from geometry_msgs.msg import Vector3 as Vector3Msg
from rclpy.clock import Clock, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time

from head_tracking.tf.buffer_interface import AnyTime, BufferInterface, convert, why_not
from head_tracking.tf.conversions import seconds, stamp_to_ns
from head_tracking.tf.do_transform import MAKERS
from head_tracking.tf.messages import header, read, transform_stamped
from head_tracking.tf.tf2_messages import FrameGraph
from head_tracking.transforms import TransformBuffer, TransformException, Vector3
from head_tracking.transforms.history import DEFAULT_CACHE_TIME

VelocityCore = tuple[Vector3, Vector3]


class BufferCore:
    """All frames over time, without waiting; tf2_py's names.

    Args:
        cache_time: how much of the past is kept; 10 s by default.

    Attributes:
        core: the buffer itself, without messages.
    """

    def __init__(self, cache_time: Duration | None = None) -> None:
        self.core = TransformBuffer(
            DEFAULT_CACHE_TIME if cache_time is None else cache_time.nanoseconds
        )

    def set_transform(
        self, transform: TransformStamped, authority: str = "default_authority"
    ) -> None:
        """Takes a measured transform.

        Raises:
            InvalidArgumentException: it makes no sense; nothing is taken. (tf2 only logs it.)
        """
        stamp, parent, child, numbers = read(transform)
        self.core.set_transform(stamp, parent, child, numbers, authority=authority)

    def set_transform_static(
        self, transform: TransformStamped, authority: str = "default_authority"
    ) -> None:
        """Takes a transform that never changes; see `set_transform`."""
        stamp, parent, child, numbers = read(transform)
        self.core.set_transform(stamp, parent, child, numbers, static=True, authority=authority)

    def clear(self) -> None:
        """Forgets everything recorded; static transforms and the robot model stay."""
        self.core.clear()

    def lookup_transform_core(
        self, target_frame: str, source_frame: str, time: AnyTime
    ) -> TransformStamped:
        """The transform that takes points from source to target, if it is known now.

        Raises:
            TransformException: see `TransformBuffer.lookup_transform`.
        """
        found = self.core.lookup_transform(target_frame, source_frame, stamp_to_ns(time))
        return transform_stamped(found)

    def lookup_transform_full_core(
        self,
        target_frame: str,
        target_time: AnyTime,
        source_frame: str,
        source_time: AnyTime,
        fixed_frame: str,
    ) -> TransformStamped:
        """From source at one time to target at another, if it is known now.

        Raises:
            TransformException: see `TransformBuffer.lookup_transform_full`.
        """
        times = stamp_to_ns(target_time), stamp_to_ns(source_time)
        return transform_stamped(
            self.core.lookup_transform_full(
                target_frame, times[0], source_frame, times[1], fixed_frame
            )
        )

    def can_transform_core(
        self, target_frame: str, source_frame: str, time: AnyTime
    ) -> tuple[bool, str]:
        """Whether `lookup_transform_core` would answer, and why not."""
        reason = self.core.why_not(target_frame, source_frame, stamp_to_ns(time))
        return not reason, reason

    def can_transform_full_core(
        self,
        target_frame: str,
        target_time: AnyTime,
        source_frame: str,
        source_time: AnyTime,
        fixed_frame: str,
    ) -> tuple[bool, str]:
        """Whether `lookup_transform_full_core` would answer, and why not."""
        reason = why_not(
            lambda: self.lookup_transform_full_core(
                target_frame, target_time, source_frame, source_time, fixed_frame
            )
        )
        return not reason, reason

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Time:
        """The newest time at which both frames are known; zero if nothing ever changes.

        Raises:
            TransformException: there is none.
        """
        return Time(nanoseconds=self.core.get_latest_common_time(target_frame, source_frame))

    def lookupVelocityCore(
        self,
        tracking_frame: str,
        observation_frame: str,
        time: AnyTime,
        averaging_interval: Duration,
    ) -> VelocityCore:
        """Linear and angular velocity [m/s, rad/s]; see `TransformBuffer.lookup_velocity`."""
        found = self.core.lookup_velocity(
            tracking_frame, observation_frame, stamp_to_ns(time), averaging_interval.nanoseconds
        )
        return found.linear, found.angular

    def lookupVelocityFullCore(
        self,
        tracking_frame: str,
        observation_frame: str,
        reference_frame: str,
        reference_point: Vector3,
        reference_point_frame: str,
        time: AnyTime,
        averaging_interval: Duration,
    ) -> VelocityCore:
        """Linear and angular velocity [m/s, rad/s]; see `TransformBuffer.lookup_velocity`."""
        found = self.core.lookup_velocity(
            tracking_frame,
            observation_frame,
            stamp_to_ns(time),
            averaging_interval.nanoseconds,
            reference_frame,
            reference_point,
            reference_point_frame,
        )
        return found.linear, found.angular

    def all_frames_as_string(self) -> str:
        """A sentence a frame."""
        return self.core.all_frames_as_string()

    def all_frames_as_yaml(self, time: AnyTime | None = None) -> str:
        """What is known of each frame; with delays if the time is given."""
        return self.core.all_frames_as_yaml(0 if time is None else stamp_to_ns(time))

    def _frameExists(self, frame_id: str) -> bool:
        return frame_id in self.core.frames()

    def _getFrameStrings(self) -> list[str]:
        return list(self.core.frames())


class Buffer(BufferCore, BufferInterface):
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
        BufferCore.__init__(self, cache_time)
        BufferInterface.__init__(self)
        self.clock = Clock() if node is None else node.get_clock()
        threshold = JumpThreshold(
            min_forward=None, min_backward=Duration(seconds=-1), on_clock_change=True
        )
        self.jump_handle = self.clock.create_jump_callback(
            threshold, post_callback=self.time_jump_callback
        )
        if node is not None and FrameGraph is not None:
            self.srv = node.create_service(FrameGraph, "tf2_frames", self._on_frame_graph)

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: AnyTime, timeout: Duration | None = None
    ) -> TransformStamped:
        """The transform that takes points from source to target.

        Raises:
            TransformException: see `TransformBuffer.lookup_transform`.
        """
        patience = 0.0 if timeout is None else seconds(timeout)
        return transform_stamped(
            self.core.lookup_transform(target_frame, source_frame, stamp_to_ns(time), patience)
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
        stamp, patience = stamp_to_ns(time), 0.0 if timeout is None else seconds(timeout)
        if not return_debug_tuple:
            return self.core.can_transform(target_frame, source_frame, stamp, patience)
        reason = self.core.why_not(target_frame, source_frame, stamp, patience)
        return not reason, reason

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
        linear, angular = (Vector3Msg(x=x, y=y, z=z) for x, y, z in (found.linear, found.angular))
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
        """As `BufferInterface.transform`."""
        make = MAKERS.get(self.registration.get(type(object_stamped)))
        if make is None:
            return super().transform(object_stamped, target_frame, timeout, new_type)
        at = object_stamped.header
        patience = 0.0 if timeout is None else seconds(timeout)
        moved = make(
            object_stamped,
            self.core.lookup_transform(target_frame, at.frame_id, stamp_to_ns(at.stamp), patience),
        )
        return moved if new_type is None else convert(moved, new_type)

    def wait_for_transform_async(
        self, target_frame: str, source_frame: str, time: AnyTime
    ) -> Future:
        """A future that gets the transform as soon as it is there."""
        return self._future(lambda: self.lookup_transform(target_frame, source_frame, time))

    def wait_for_transform_full_async(
        self,
        target_frame: str,
        target_time: AnyTime,
        source_frame: str,
        source_time: AnyTime,
        fixed_frame: str,
    ) -> Future:
        """A future that gets the transform as soon as it is there."""
        return self._future(
            lambda: self.lookup_transform_full(
                target_frame, target_time, source_frame, source_time, fixed_frame
            )
        )

    async def lookup_transform_async(
        self, target_frame: str, source_frame: str, time: AnyTime
    ) -> TransformStamped:
        """The transform, as soon as it is there."""
        return await self.wait_for_transform_async(target_frame, source_frame, time)

    async def lookup_transform_full_async(
        self,
        target_frame: str,
        target_time: AnyTime,
        source_frame: str,
        source_time: AnyTime,
        fixed_frame: str,
    ) -> TransformStamped:
        """The transform, as soon as it is there."""
        return await self.wait_for_transform_full_async(
            target_frame, target_time, source_frame, source_time, fixed_frame
        )

    def _future(self, lookup: Callable[[], TransformStamped]) -> Future:
        future, found = Future(), []

        def possible() -> bool:
            try:
                found.append(lookup())
            except TransformException:
                return False
            return True

        request = self.core.when(possible, lambda: future.set_result(found[-1]))
        # who cancels the future is not called any more
        future.add_done_callback(lambda _: self.core.withdraw(request))
        return future

    def time_jump_callback(self, _: TimeJump) -> None:
        """Forgets what was recorded before the clock jumped."""
        get_logger("head_tracking.tf").warning("time jumped back: the transform buffer is cleared")
        self.clear()

    def _on_frame_graph(self, _: Any, response: Any) -> Any:
        response.frame_yaml = self.all_frames_as_yaml()
        return response
