"""An action server for goals that a control loop carries out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node


class Goal:
    """One goal, for what carries it out; for any thread.

    Args:
        node: serves.
        handle: rclpy's.

    Attributes:
        request: what the client wants.
        feedback: publishes a message for the client.
        on_cancel: called when the client wants it no more; it ends the goal.
    """

    def __init__(self, node: Node, handle: Any) -> None:
        self.request = handle.request
        self.feedback: Callable[[Any], object] = handle.publish_feedback
        self.on_cancel: Callable[[], object] = lambda: None
        self._node, self._handle = node, handle
        self._end: tuple[Callable[[], object], Any] | None = None

    @property
    def is_over(self) -> bool:
        """Whether it has a result."""
        return self._end is not None

    def succeed(self, result: Any) -> None:
        """End it well."""
        self._execute(self._handle.succeed, result)

    def abort(self, result: Any) -> None:
        """End it, because it cannot be reached, or because another one has come."""
        self._execute(self._handle.abort, result)

    def cancel(self, result: Any) -> None:
        """End it as the client wants."""
        handle = self._handle
        self._execute(
            lambda: handle.canceled() if handle.is_cancel_requested else handle.abort(), result
        )

    def conclude(self) -> Any:
        """Set the last status and return the result."""
        assert self._end is not None
        set_status, result = self._end
        set_status()
        return result

    def _execute(self, set_status: Callable[[], object], result: Any) -> None:
        if self._end is None:
            self._end = set_status, result
            if self._node.executor is not None:  # else the program ends
                self._handle.execute()


class GoalServer:
    """Accepts goals, and answers each when it has a result; in between no callback waits.

    An execute callback of rclpy that waits is resumed again and again by its executor, as fast as
    that can. So the execution of a goal is deferred (`handle_accepted_callback`): the loop carries
    it out, and `execute` hands its result over. Until then its status is "accepted".

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
        ActionServer(
            node,
            kind,
            name,
            lambda handle: self._goals.pop(_id(handle)).conclude(),
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
        )

    def _on_goal(self, request: Any) -> GoalResponse:
        return GoalResponse.REJECT if self._refusal(request) else GoalResponse.ACCEPT

    def _on_accepted(self, handle: Any) -> None:
        goal = self._goals[_id(handle)] = Goal(self._node, handle)
        self._begin(goal)

    def _on_cancel(self, handle: Any) -> CancelResponse:
        goal = self._goals.get(_id(handle))
        if goal is None or goal.is_over:
            return CancelResponse.REJECT
        goal.on_cancel()
        return CancelResponse.ACCEPT


def _id(handle: Any) -> bytes:
    return bytes(handle.goal_id.uuid)
