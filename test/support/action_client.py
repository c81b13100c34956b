"""A stock client of an action, as a person in another process would have it."""

import time
from collections.abc import Callable
from typing import Any

from rclpy.action import ActionClient
from waiting import wait_for

ACCEPTED, SUCCEEDED, CANCELED, ABORTED = 1, 4, 5, 6  # action_msgs/GoalStatus


def in_executor(node: Any, call: Callable[[], Any]) -> Any:
    """What a call in the thread of a node's executor returns.

    rclpy's action client loses an answer that comes before it has noted what it asked: it must ask
    where answers are taken.
    """
    task = node.executor.create_task(call)
    wait_for(task.done)
    return task.result()


class Sent:
    """A goal on its way."""

    def __init__(self, node: Any, client: ActionClient, goal: Any) -> None:
        self.feedback: list[tuple[float, Any]] = []  # what it said on the way, with the time [s]
        self._node = node
        future = in_executor(
            node, lambda: client.send_goal_async(goal, feedback_callback=self._on_feedback)
        )
        wait_for(future.done)
        self._handle = future.result()
        self.accepted = self._handle.accepted  # whether the server took it
        if self.accepted:
            self._result = in_executor(node, self._handle.get_result_async)

    def _on_feedback(self, message: Any) -> None:
        self.feedback.append((time.monotonic(), message.feedback))

    @property
    def status(self) -> int:
        """The status by the server's topic."""
        return int(self._handle.status)

    def ended(self) -> tuple[int, Any]:
        """Waits for the end: status and result."""
        wait_for(self._result.done)
        answer = self._result.result()
        return answer.status, answer.result

    def cancel(self) -> Any:
        """Asks the server to; its answer."""
        future = in_executor(self._node, self._handle.cancel_goal_async)
        wait_for(future.done)
        return future.result()


class Client:
    """Sends goals to one server."""

    def __init__(self, node: Any, kind: Any, name: str) -> None:
        self._node = node
        self._client = ActionClient(node, kind, name)
        wait_for(self._client.server_is_ready)

    def send(self, goal: Any) -> Sent:
        """A goal, once the server has answered whether it takes it."""
        return Sent(self._node, self._client, goal)
