"""An action server for goals that a control loop executes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node


class _Server(ActionServer):
    """An action server that calls `execute_callback` when the result of a goal is known.

    rclpy's executors resume a callback that awaits a result in a busy loop. Here `execute` only
    sets the status of the goal, and the callback that returns the result is scheduled later.
    """

    def notify_execute(
        self, goal_handle: Any, execute_callback: Callable[[Any], object] | None
    ) -> None:
        if execute_callback is not None:
            super().notify_execute(goal_handle, execute_callback)


class Goal:
    """One goal; for any thread.

    Args:
        handle: rclpy's goal handle.
        on_result: called once, with a function that sets the status and returns the result.

    Attributes:
        request: the goal message.
        feedback: publishes a feedback message.
        on_cancel: called when the client cancels; it must end the goal.
        is_over: whether it has a result.
    """

    def __init__(self, handle: Any, on_result: Callable[[Callable[[Any], Any]], object]) -> None:
        self.request = handle.request
        self.feedback: Callable[[Any], object] = handle.publish_feedback
        self.on_cancel: Callable[[], object] = lambda: None
        self.is_over = False
        self._handle, self._on_result = handle, on_result

    def succeed(self, result: Any) -> None:
        """End the goal with success."""
        self._end(self._handle.succeed, result)

    def abort(self, result: Any) -> None:
        """End the goal because it cannot be reached, or was preempted."""
        self._end(self._handle.abort, result)

    def cancel(self, result: Any) -> None:
        """End the goal at the request of the client."""
        handle = self._handle
        self._end(
            lambda: handle.canceled() if handle.is_cancel_requested else handle.abort(), result
        )

    def _end(self, set_status: Callable[[], object], result: Any) -> None:
        def conclude(_: Any) -> Any:
            set_status()
            return result

        if not self.is_over:
            self.is_over = True
            self._on_result(conclude)


class GoalServer:
    """Accepts goals, and returns the result of each when it is known.

    Args:
        node: offers the action.
        kind: type of the action.
        name: of the action.
        refusal: returns why a goal is rejected; empty: it is accepted.
        begin: starts the execution of a goal.
    """

    def __init__(
        self,
        node: Node,
        kind: type,
        name: str,
        refusal: Callable[[Any], str],
        begin: Callable[[Goal], object],
    ) -> None:
        self._node, self._refusal, self._begin = node, refusal, begin
        self._goals: dict[bytes, Goal] = {}
        self._server = _Server(
            node,
            kind,
            name,
            lambda _: None,
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
        )

    def _on_goal(self, request: Any) -> GoalResponse:
        return GoalResponse.REJECT if self._refusal(request) else GoalResponse.ACCEPT

    def _on_accepted(self, handle: Any) -> None:
        def on_result(conclude: Callable[[Any], Any]) -> None:
            del self._goals[_id(handle)]
            if self._node.executor is not None:  # else the program ends
                self._server.notify_execute(handle, conclude)

        goal = self._goals[_id(handle)] = Goal(handle, on_result)
        handle.execute()
        self._begin(goal)

    def _on_cancel(self, handle: Any) -> CancelResponse:
        goal = self._goals.get(_id(handle))
        if goal is None:
            return CancelResponse.REJECT
        goal.on_cancel()
        return CancelResponse.ACCEPT


def _id(handle: Any) -> bytes:
    return bytes(handle.goal_id.uuid)
