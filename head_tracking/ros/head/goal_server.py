"""An action server for goals that a control loop carries out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node


class _Server(ActionServer):
    """rclpy's action server, for goals that no callback waits for.

    A callback that waits is resumed again and again by rclpy's executor, as fast as that can. So a
    goal is executing from `execute` on, and its callback is called when its result is there.
    """

    def notify_execute(
        self, goal_handle: Any, execute_callback: Callable[[Any], object] | None
    ) -> None:
        if execute_callback is not None:
            super().notify_execute(goal_handle, execute_callback)


class Goal:
    """One goal, for what carries it out; for any thread.

    Args:
        handle: rclpy's.
        on_result: called once, with what sets the last status and returns the result.

    Attributes:
        request: what the client wants.
        feedback: publishes a message for the client.
        on_cancel: called when the client wants it no more; it ends the goal.
        is_over: whether it has a result.
    """

    def __init__(self, handle: Any, on_result: Callable[[Callable[[Any], Any]], object]) -> None:
        self.request = handle.request
        self.feedback: Callable[[Any], object] = handle.publish_feedback
        self.on_cancel: Callable[[], object] = lambda: None
        self.is_over = False
        self._handle, self._on_result = handle, on_result

    def succeed(self, result: Any) -> None:
        """End it well."""
        self._end(self._handle.succeed, result)

    def abort(self, result: Any) -> None:
        """End it, because it cannot be reached, or because another one has come."""
        self._end(self._handle.abort, result)

    def cancel(self, result: Any) -> None:
        """End it as the client wants."""
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
    """Accepts goals, and answers each when it has a result; in between no callback waits.

    Args:
        node: serves.
        kind: of the action.
        name: of the action.
        refusal: returns why a goal is not accepted; an empty string: it is.
        begin: begins to carry one out.
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
