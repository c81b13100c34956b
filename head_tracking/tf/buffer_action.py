"""A buffer in one process, asked from another: tf2_ros's action of lookups; needs tf2_msgs."""

from __future__ import annotations

import threading
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.action import ActionClient, ActionServer
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time

from head_tracking.tf.buffer import Buffer
from head_tracking.tf.buffer_interface import AnyTime, BufferInterface
from head_tracking.tf.conversions import ns_to_stamp, seconds, stamp_to_ns
from head_tracking.tf.tf2_messages import LookupTransform, TF2Error, require_tf2_msgs
from head_tracking.transforms import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)

# in the order of TF2Error's numbers, from 1
_EXCEPTIONS: tuple[type[TransformException], ...] = (
    LookupException,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    TimeoutException,
    TransformException,
)


class BufferClient(BufferInterface):
    """Asks a `BufferServer`; another thread has to spin the node.

    Args:
        node: asks.
        ns: the name of the server's action.
        check_frequency: as in tf2_ros; nothing is polled here.
        timeout_padding: how much longer than a lookup's own timeout the server may take.

    Raises:
        ImportError: tf2_msgs is not installed.
    """

    def __init__(
        self,
        node: Node,
        ns: str,
        check_frequency: float = 10.0,
        timeout_padding: Duration | None = None,
    ) -> None:
        require_tf2_msgs()
        super().__init__()
        self.node = node
        self.action_client = ActionClient(node, LookupTransform, ns)
        self.check_frequency = check_frequency
        self.timeout_padding = timeout_padding or Duration(seconds=2.0)

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: AnyTime, timeout: Duration | None = None
    ) -> TransformStamped:
        """The transform that takes points from source to target.

        Raises:
            TimeoutException: no server, or no answer of it.
            TransformException: as the server's buffer raises it.
        """
        return self._ask(
            timeout,
            target_frame=target_frame,
            source_frame=source_frame,
            source_time=ns_to_stamp(stamp_to_ns(time)),
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
        """From source at one time to target at another; raises as `lookup_transform`."""
        return self._ask(
            timeout,
            advanced=True,
            target_frame=target_frame,
            target_time=ns_to_stamp(stamp_to_ns(target_time)),
            source_frame=source_frame,
            source_time=ns_to_stamp(stamp_to_ns(source_time)),
            fixed_frame=fixed_frame,
        )

    def _ask(self, timeout: Duration | None, **goal: Any) -> TransformStamped:
        if not self.action_client.server_is_ready():
            raise TimeoutException("the BufferServer is not ready; is its node running?")
        patience = seconds(timeout) + seconds(self.timeout_padding)
        wish = LookupTransform.Goal(timeout=(timeout or Duration()).to_msg(), **goal)
        handle = _waited_for(self.action_client.send_goal_async(wish), patience)
        if not handle.accepted:
            raise TimeoutException("the BufferServer does not accept the lookup")
        result = _waited_for(handle.get_result_async(), patience).result
        error = result.error
        if error.error != TF2Error.NO_ERROR:
            raise _EXCEPTIONS[min(error.error, len(_EXCEPTIONS)) - 1](error.error_string)
        found: TransformStamped = result.transform
        return found


class BufferServer:
    """Answers lookups of other processes.

    Args:
        node: answers; its executor must spin.
        buffer: has the transforms.
        ns: the name of the action.

    Raises:
        ImportError: tf2_msgs is not installed.
    """

    def __init__(self, node: Node, buffer: Buffer, ns: str) -> None:
        require_tf2_msgs()
        self.node = node
        self.buffer = buffer
        self._clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.action_server = ActionServer(
            node, LookupTransform, ns, self._answer, callback_group=ReentrantCallbackGroup()
        )

    async def _answer(self, handle: Any) -> Any:
        goal, result = handle.request, LookupTransform.Result()
        wish: tuple[Any, ...] = goal.target_frame, goal.source_frame, _time(goal.source_time)
        lookup: Any = self.buffer.lookup_transform
        wait: Any = self.buffer.wait_for_transform_async
        if goal.advanced:
            lookup = self.buffer.lookup_transform_full
            wait = self.buffer.wait_for_transform_full_async
            wish = (
                goal.target_frame,
                _time(goal.target_time),
                goal.source_frame,
                _time(goal.source_time),
                goal.fixed_frame,
            )
        patience = seconds(Duration.from_msg(goal.timeout))
        if patience > 0.0:
            waiting = wait(*wish)
            timer = self.node.create_timer(patience, waiting.cancel, clock=self._clock)
            # what comes in another thread does not wake the executor
            waiting.add_done_callback(lambda _: self.node.executor.wake())
            await waiting
            self.node.destroy_timer(timer)
        try:
            result.transform = lookup(*wish)
        except TransformException as error:
            kinds = [isinstance(error, kind) for kind in _EXCEPTIONS]
            result.error = TF2Error(error=kinds.index(True) + 1, error_string=str(error))
            handle.abort()
        else:
            handle.succeed()
        return result


def _time(stamp: Any) -> Time:
    return Time(nanoseconds=stamp_to_ns(stamp))


def _waited_for(future: Future, patience: float) -> Any:
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    if not done.wait(patience):
        future.cancel()
        raise TimeoutException(f"the BufferServer did not answer within {patience:.1f} s")
    return future.result()
