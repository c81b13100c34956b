"""A node that no executor spins: its messages wait until somebody polls it.

Waking an executor for each message costs several times as much as the message itself. Whoever
samples frequent topics polls them instead.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

_EVENT_PERIOD = 1.0  # s
_MOST = 200  # messages of a subscription in one poll: a flood must not keep the caller


class PolledNode(Node):
    """A node beside another one, with subscriptions only.

    Args:
        beside: gives namespace, context and kind of time.
        name: of the new node.
        report: receives a text when a callback raises an error; that costs its message only.
    """

    def __init__(self, beside: Node, name: str, report: Callable[[str], None]) -> None:
        sim_time = beside.get_parameter("use_sim_time").value
        super().__init__(
            name,
            namespace=beside.get_namespace(),
            context=beside.context,
            start_parameter_services=False,
            parameter_overrides=[Parameter("use_sim_time", value=bool(sim_time))],
        )
        self._report = report
        self._polling = threading.Lock()
        self._events = SingleThreadedExecutor(context=beside.context)
        self._events.add_node(self)
        self._events_due = 0.0

    def poll(self) -> None:
        """Call the callbacks of all subscriptions with the messages that have come; never wait."""
        with self._polling:
            for subscription in list(self.subscriptions):
                for _ in range(_MOST):
                    taken = take_message(subscription)
                    if taken is None:
                        break
                    self._call(subscription.callback, taken[0])
            if time.monotonic() >= self._events_due:  # such as a publisher of other reliability
                self._events_due = time.monotonic() + _EVENT_PERIOD
                self._call(self._events.spin_once, 0.0)

    def destroy_node(self) -> None:
        """Wait for a poll in another thread, then destroy the node."""
        with self._polling:
            self._events.shutdown()
            super().destroy_node()

    def _call(self, callback: Callable[..., object], argument: Any) -> None:
        try:
            callback(argument)
        except Exception as error:
            self._report(f"{type(error).__name__}: {error}")


def take_message(subscription: Any) -> tuple[Any, dict[str, Any]] | None:
    """Return the next message of a subscription and what the middleware knows of it; or None."""
    with contextlib.suppress(InvalidHandle), subscription.handle:  # it may be destroyed meanwhile
        taken: tuple[Any, dict[str, Any]] | None = subscription.handle.take_message(
            subscription.msg_type, subscription.raw
        )
        return taken
    return None
