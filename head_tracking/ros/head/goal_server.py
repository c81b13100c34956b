"""An action server for goals that a control loop executes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node

from head_tracking.head.motions import MotionEnd


class ActionGoal:
    """One goal; for any thread.

    Attributes:
        request: the goal message.
        feedback: publishes a feedback message.
        on_cancel: called when the client cancels; it must end the goal.
    """

    def __init__(self, node: Node, handle: Any, goals: dict[bytes, ActionGoal]) -> None:
        self.request = handle.request
        self.feedback: Callable[[Any], object] = handle.publish_feedback
        self.on_cancel: Callable[[], object] = lambda: None
        self._node, self._handle, self._goals = node, handle, goals
        goals[bytes(handle.goal_id.uuid)] = self

    def end(self, end: MotionEnd, result: Any) -> None:
        """End the goal, unless it has ended."""

        def conclude(handle: Any) -> Any:
            if end is MotionEnd.SUCCEEDED:
                handle.succeed()
            elif end is MotionEnd.CANCELED and handle.is_cancel_requested:
                handle.canceled()
            else:
                handle.abort()
            return result

        goal, executor = bytes(self._handle.goal_id.uuid), self._node.executor
        if self._goals.pop(goal, None) is not None and executor is not None:
            executor.create_task(self._handle.execute, conclude)


def serve_goals(
    node: Node,
    kind: type,
    name: str,
    refusal: Callable[[Any], str],
    begin: Callable[[ActionGoal], object],
) -> None:
    """Offer an action.

    rclpy's executors resume a callback that awaits a result in a busy loop. So a goal is `accepted`
    until its result is known, and only then `executing`, for a moment.

    Args:
        node: offers the action.
        kind: type of the action.
        name: of the action.
        refusal: returns why a goal is rejected; empty: it is accepted.
        begin: starts the execution of a goal.
    """
    goals: dict[bytes, ActionGoal] = {}

    def cancel(handle: Any) -> CancelResponse:
        goal = goals.get(bytes(handle.goal_id.uuid))
        if goal is None:
            return CancelResponse.REJECT
        goal.on_cancel()
        return CancelResponse.ACCEPT

    ActionServer(
        node,
        kind,
        name,
        lambda _: None,
        goal_callback=lambda request: (
            GoalResponse.REJECT if refusal(request) else GoalResponse.ACCEPT
        ),
        handle_accepted_callback=lambda handle: begin(ActionGoal(node, handle, goals)),
        cancel_callback=cancel,
    )
