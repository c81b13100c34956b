"""The transform buffer for ROS messages, with the names and arguments of tf2_ros and tf2_py.

`head_tracking.transforms.TransformBuffer` documents arguments and errors of the lookups.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partialmethod
from typing import Any, TypeAlias

from builtin_interfaces.msg import Time as TimeMsg
from geometry_msgs.msg import TransformStamped
from rclpy.clock import Clock, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time

from head_tracking.tf.conversions import seconds, stamp_to_ns
from head_tracking.tf.do_transform import MAKERS, TransformRegistration
from head_tracking.tf.messages import FrameGraph, read, transform_stamped
from head_tracking.transforms import TransformBuffer, TransformException
from head_tracking.transforms.history import DEFAULT_CACHE_TIME

AnyTime: TypeAlias = Time | TimeMsg


class Buffer:
    """All frames over time; a replacement for tf2_ros.Buffer and tf2_py.BufferCore.

    ``Time()`` is the latest common time. A lookup with a timeout waits for missing data, which
    must come from another thread.

    Args:
        cache_time: how much of the past is kept; 10 s by default.
        node: if its clock jumps back, the buffer is cleared. Offers the service `tf2_frames` where
            tf2_msgs is installed.

    Attributes:
        core: the buffer without messages.
        registration: the function that transforms each type of message.
        robots: topic and prefix of the robot of each listener that computes its links: one robot.
    """

    def __init__(self, cache_time: Duration | None = None, node: Node | None = None) -> None:
        self.core = TransformBuffer(
            DEFAULT_CACHE_TIME if cache_time is None else cache_time.nanoseconds
        )
        self.registration = TransformRegistration()
        self.robots: list[tuple[str, str]] = []
        self.clock = Clock() if node is None else node.get_clock()
        threshold = JumpThreshold(
            min_forward=None, min_backward=Duration(seconds=-1), on_clock_change=True
        )
        self.jump_handle = self.clock.create_jump_callback(
            threshold, post_callback=self.time_jump_callback
        )
        if node is not None and FrameGraph is not None:
            self.srv = node.create_service(FrameGraph, "tf2_frames", self._on_frame_graph)

    def set_transform(
        self, transform: TransformStamped, authority: str = "default_authority"
    ) -> None:
        """Record a measured transform.

        Raises:
            InvalidArgumentException: it is not valid. (tf2 only logs that.)
        """
        stamp, parent, child, numbers = read(transform)
        self.core.set_transform(stamp, parent, child, numbers, authority=authority)

    def set_transform_static(
        self, transform: TransformStamped, authority: str = "default_authority"
    ) -> None:
        """Record a transform that never changes; see `set_transform`."""
        stamp, parent, child, numbers = read(transform)
        self.core.set_transform(stamp, parent, child, numbers, static=True, authority=authority)

    def clear(self) -> None:
        """Discard all samples; static transforms and the robot model stay."""
        self.core.clear()

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: AnyTime,
        source_frame: str,
        source_time: AnyTime,
        fixed_frame: str,
        timeout: Duration | None = None,
    ) -> TransformStamped:
        """Return the transform from source at one time to target at another time."""
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

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Time:
        """Return the latest time at which both frames are known; 0 if they never move."""
        return Time(nanoseconds=self.core.get_latest_common_time(target_frame, source_frame))

    def all_frames_as_string(self) -> str:
        """Return a sentence for each frame."""
        return self.core.all_frames_as_string()

    def all_frames_as_yaml(self, time: AnyTime | None = None) -> str:
        """Return parent, rate and stamps of each frame; with delays if the time is given."""
        return self.core.all_frames_as_yaml(0 if time is None else stamp_to_ns(time))

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: AnyTime, timeout: Duration | None = None
    ) -> TransformStamped:
        """Return the transform that takes points from source to target."""
        return transform_stamped(
            self.core.lookup_transform(
                target_frame, source_frame, stamp_to_ns(time), seconds(timeout)
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
        """Return whether `lookup_transform` succeeds; with `return_debug_tuple` also why not."""
        stamp, patience = stamp_to_ns(time), seconds(timeout)
        if not return_debug_tuple:
            return self.core.can_transform(target_frame, source_frame, stamp, patience)
        reason = self.core.why_not(target_frame, source_frame, stamp, patience)
        return not reason, reason

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
        """Return whether `lookup_transform_full` succeeds; see `can_transform`."""
        reason = ""
        try:
            self.lookup_transform_full(
                target_frame, target_time, source_frame, source_time, fixed_frame, timeout
            )
        except TransformException as error:
            reason = str(error)
        return (not reason, reason) if return_debug_tuple else not reason

    # tf2_py's names; they do not wait, because they have no timeout
    lookup_transform_core = lookup_transform
    lookup_transform_full_core = lookup_transform_full
    can_transform_core = partialmethod(can_transform, return_debug_tuple=True)
    can_transform_full_core = partialmethod(can_transform_full, return_debug_tuple=True)

    def transform(
        self,
        object_stamped: Any,
        target_frame: str,
        timeout: Duration | None = None,
    ) -> Any:
        """Transform a stamped message to `target_frame`, at its own stamp.

        Raises:
            TypeException: the message cannot be transformed.
            TransformException: see `lookup_transform`.
        """
        do_transform, at = self.registration.get(type(object_stamped)), object_stamped.header
        make = MAKERS.get(do_transform)
        found = self.core.lookup_transform(
            target_frame, at.frame_id, stamp_to_ns(at.stamp), seconds(timeout)
        )
        if make is None:
            return do_transform(object_stamped, transform_stamped(found))
        return make(object_stamped, found)

    def transform_full(
        self,
        object_stamped: Any,
        target_frame: str,
        target_time: AnyTime,
        fixed_frame: str,
        timeout: Duration | None = None,
    ) -> Any:
        """Transform a stamped message to `target_frame` at another time; see `transform`."""
        at = object_stamped.header
        return self.registration.get(type(object_stamped))(
            object_stamped,
            self.lookup_transform_full(
                target_frame, target_time, at.frame_id, at.stamp, fixed_frame, timeout or Duration()
            ),
        )

    def _future(self, lookup: Callable[..., TransformStamped], *where: Any, **named: Any) -> Future:
        """Return a future of a lookup, which is done when the lookup succeeds."""
        future, found = Future(), []

        def possible() -> bool:
            try:
                found.append(lookup(self, *where, **named))
            except TransformException:
                return False
            return True

        request = self.core.when(possible, lambda: future.set_result(found[-1]))
        future.add_done_callback(lambda _: self.core.withdraw(request))  # also if it is cancelled
        return future

    async def _awaited(
        self, lookup: Callable[..., TransformStamped], *where: Any, **named: Any
    ) -> TransformStamped:
        """Await a lookup."""
        return await self._future(lookup, *where, **named)

    # with the arguments of the lookup that they are named after, but no timeout
    wait_for_transform_async = partialmethod(_future, lookup_transform)
    wait_for_transform_full_async = partialmethod(_future, lookup_transform_full)
    lookup_transform_async = partialmethod(_awaited, lookup_transform)
    lookup_transform_full_async = partialmethod(_awaited, lookup_transform_full)

    def time_jump_callback(self, _: TimeJump) -> None:
        """Clear the buffer."""
        get_logger("head_tracking.tf").warning("time jumped back: the transform buffer is cleared")
        self.clear()

    def _on_frame_graph(self, _: Any, response: Any) -> Any:
        response.frame_yaml = self.all_frames_as_yaml()
        return response


BufferCore = BufferInterface = Buffer
"""tf2's base classes, for type hints."""
