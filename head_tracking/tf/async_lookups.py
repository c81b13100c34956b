"""Lookups that somebody awaits."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, TypeAlias

from builtin_interfaces.msg import Time as TimeMsg
from geometry_msgs.msg import TransformStamped
from rclpy.task import Future
from rclpy.time import Time

from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.transforms import TransformBuffer, TransformException

AnyTime: TypeAlias = Time | TimeMsg


class AsyncLookups(ABC):
    """The part of a buffer that waits without blocking.

    Attributes:
        core: the buffer itself, without messages.
    """

    core: TransformBuffer

    @abstractmethod
    def lookup_transform(
        self, target_frame: str, source_frame: str, time: AnyTime
    ) -> TransformStamped:
        """See `Buffer`."""

    @abstractmethod
    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: AnyTime,
        source_frame: str,
        source_time: AnyTime,
        fixed_frame: str,
    ) -> TransformStamped:
        """See `Buffer`."""

    def wait_for_transform_async(
        self, target_frame: str, source_frame: str, time: AnyTime
    ) -> Future:
        """A future that gets the transform as soon as it is there."""
        stamp = stamp_to_ns(time)
        return _future(
            lambda: self.lookup_transform(target_frame, source_frame, time),
            lambda done: self.core.when_transformable(target_frame, source_frame, stamp, done),
            self.core.withdraw,
        )

    def wait_for_transform_full_async(
        self,
        target_frame: str,
        target_time: AnyTime,
        source_frame: str,
        source_time: AnyTime,
        fixed_frame: str,
    ) -> Future:
        """A future that gets the transform as soon as it is there."""
        times = stamp_to_ns(target_time), stamp_to_ns(source_time)
        return _future(
            lambda: self.lookup_transform_full(
                target_frame, target_time, source_frame, source_time, fixed_frame
            ),
            lambda done: self.core.when_transformable_full(
                target_frame, times[0], source_frame, times[1], fixed_frame, done
            ),
            self.core.withdraw,
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


def _future(
    lookup: Callable[[], TransformStamped],
    ask: Callable[[Callable[[], None]], Any],
    withdraw: Callable[[Any], None],
) -> Future:
    future = Future()

    def possible() -> None:
        try:
            future.set_result(lookup())
        except TransformException as error:
            future.set_exception(error)

    request = ask(possible)
    # who cancels the future is not called any more
    future.add_done_callback(lambda _: withdraw(request))
    return future
