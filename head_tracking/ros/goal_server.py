"""An action server for goals that a control loop carries out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node


class Goal:
    """One goal, for what carries it out; for any thread.

    Attributes:
        request: what the client wants.
        on_cancel: called when the client wants it no more.
    """

    def __init__(self, server: GoalServer, handle: Any) -> None:
        self.request = handle.request
        self.on_cancel: Callable[[], object] = lambda: None
        self.feedback: Callable[[Any], object] = handle.publish_feedback
        self._server = server
        self._handle = handle

    def succeed(self, result: Any) -> None:
        """Ends it well."""
        self._server.end(self._handle, result, self._handle.succeed)

    def abort(self, result: Any) -> None:
        """Ends it, because it cannot be reached, or because another one has come."""
        self._server.end(self._handle, result, self._handle.abort)

    def cancel(self, result: Any) -> None:
        """Ends it as the client wants."""
        self._server.end(self._handle, result, self._canceled)

    def _canceled(self) -> None:
        (self._handle.canceled if self._handle.is_cancel_requested else self._handle.abort)()


class GoalServer(ActionServer):
    """Takes goals and ends them when it is told to; in between nothing waits.

    A callback of rclpy that waits for the end of its goal is asked again and again by its executor,
    as fast as that can. So nothing is executed when a goal begins, and what rclpy takes for its
    execution happens when it is over, in the executor's thread.

    Args:
        node: serves.
        kind: of the action.
        name: of the action.
        refusal: why a goal is not taken; an empty string: it is.
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
        self._refusal = refusal
        self._begin = begin
        self._goals: dict[bytes, Goal] = {}
        super().__init__(
            node,
            kind,
            name,
            lambda handle: None,
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
        )

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """Nothing is executed now: see the class."""

    def end(self, handle: Any, result: Any, become: Callable[[], object]) -> None:
        """Ends a goal, once.

        Args:
            handle: the goal's.
            result: for the client.
            become: gives it its last status.
        """
        known = self._goals.pop(bytes(handle.goal_id.uuid), None)
        if known is None or self._node.executor is None:  # (no executor: the program ends)
            return

        def conclude(_: Any) -> Any:
            become()
            return result

        super().notify_execute(handle, conclude)

    def _on_goal(self, goal: Any) -> GoalResponse:
        return GoalResponse.REJECT if self._refusal(goal) else GoalResponse.ACCEPT

    def _on_accepted(self, handle: Any) -> None:
        handle.execute()  # gives it its status
        goal = self._goals[bytes(handle.goal_id.uuid)] = Goal(self, handle)
        self._begin(goal)

    def _on_cancel(self, handle: Any) -> CancelResponse:
        goal = self._goals.get(bytes(handle.goal_id.uuid))
        if goal is None:
            return CancelResponse.REJECT
        goal.on_cancel()
        return CancelResponse.ACCEPT
