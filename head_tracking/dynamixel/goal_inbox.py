"""Where other threads leave goals for the thread that owns the bus."""

from __future__ import annotations

import threading
from collections.abc import Mapping

from head_tracking.dynamixel.bus_joint import BusJoint
from head_tracking.dynamixel.command import CommandResult, Goal
from head_tracking.dynamixel.exceptions import GoalError


class GoalInbox:
    """Checks commands and keeps the newest goal of each joint until the owner takes it.

    Attributes:
        refused: Commands refused so far.
        clamped: Commands accepted with at least one position moved to a limit.
    """

    def __init__(self) -> None:
        self.refused = 0
        self.clamped = 0
        self._lock = threading.Lock()
        self._goals: dict[str, Goal] = {}

    def put(
        self, joints: Mapping[str, BusJoint], goals: Mapping[str, Goal], clamp: bool
    ) -> CommandResult:
        """Accept all goals or none.

        Args:
            joints: The joints of the command.
            goals: A goal for each of them.
            clamp: Move positions outside the limits to the limit instead of refusing them.

        Raises:
            GoalError: A goal is refused, or no joint of the command answers.
        """
        positions = {name: joint.admit(goals[name], clamp) for name, joint in joints.items()}
        lost = tuple(name for name, joint in joints.items() if joint.lost)
        if lost and len(lost) == len(joints):
            raise GoalError(
                f"command refused: the servo of {', '.join(lost)} does not answer; it is asked "
                "again all the time and can be commanded once it answers"
            )
        for name in lost:
            del positions[name]
        moved = {name: position - goals[name].position for name, position in positions.items()}
        clamped = {
            name: distance
            for name, distance in moved.items()
            if abs(distance) > joints[name].configuration.resolution
        }
        with self._lock:
            for name, position in positions.items():
                self._goals[name] = Goal(position, goals[name].speed)
            self.clamped += bool(clamped)
        return CommandResult(positions, clamped, lost)

    def count_refusal(self) -> None:
        """Count a command that was refused."""
        with self._lock:
            self.refused += 1

    def drop(self, joint_name: str) -> None:
        """Forget the goal of a joint."""
        with self._lock:
            self._goals.pop(joint_name, None)

    def put_back(self, joint_name: str, goal: Goal) -> None:
        """Leave a goal for the next cycle, unless there is a newer one."""
        with self._lock:
            self._goals.setdefault(joint_name, goal)

    def take(self) -> dict[str, Goal]:
        """Return the newest goals and forget them."""
        with self._lock:
            goals, self._goals = self._goals, {}
        return goals
