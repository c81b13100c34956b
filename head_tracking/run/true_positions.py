"""Where simulated joints really are: from the process that simulates them to the camera's."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Final

from rclpy.node import Node
from sensor_msgs.msg import JointState

from head_tracking.ros.output import Output
from head_tracking.ros.spinning import steady_timer

_TOPIC: Final = "true_joint_states"
_PERIOD: Final = 0.01  # s
_LONGEST: Final = 0.05  # s that a velocity is trusted


class TruePositionsOutput:
    """Publishes where the joints really are while somebody listens.

    Args:
        node: publishes.
        joints: their names.
        true_position: returns where a joint is [rad]; None: it is not simulated.
    """

    def __init__(
        self, node: Node, joints: Sequence[str], true_position: Callable[[str], float | None]
    ) -> None:
        self._output = Output(node, JointState, _TOPIC, 1)
        self._joints, self._true_position = joints, true_position
        steady_timer(node, _PERIOD, self._publish)

    def _publish(self) -> None:
        if self._output.wanted:
            found = {joint: self._true_position(joint) for joint in self._joints}
            known = {joint: where for joint, where in found.items() if where is not None}
            self._output.publish(JointState(name=list(known), position=list(known.values())))


class TruePositions:
    """Listens for where simulated joints really are.

    Args:
        node: listens.
    """

    def __init__(self, node: Node) -> None:
        self._latest: tuple[float, dict[str, float], dict[str, float]] = 0.0, {}, {}
        node.create_subscription(JointState, _TOPIC, self._on_positions, 1)

    def now(self, joint: str) -> float | None:
        """Return where a joint is now [rad], by its latest position and velocity, or None."""
        heard, positions, velocities = self._latest
        if joint not in positions:
            return None
        elapsed = min(time.monotonic() - heard, _LONGEST)
        return positions[joint] + elapsed * velocities.get(joint, 0.0)

    def _on_positions(self, message: JointState) -> None:
        now = time.monotonic()
        heard, before, _ = self._latest
        positions = dict(zip(message.name, message.position, strict=True))
        elapsed = max(now - heard, _PERIOD)
        velocities = {
            joint: (where - before[joint]) / elapsed
            for joint, where in positions.items()
            if joint in before
        }
        self._latest = now, positions, velocities
