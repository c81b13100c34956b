"""Where simulated joints really are: from the process that simulates them to the camera's."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Final

from rclpy.node import Node
from sensor_msgs.msg import JointState

from head_tracking.ros.kit.spinning import steady_timer
from head_tracking.ros.kit.topic_output import Output
from head_tracking.tf.conversions import ns_to_stamp, stamp_to_ns

_TOPIC: Final = "true_joint_states"
_PERIOD: Final = 0.02  # s
_LONGEST: Final = 0.05  # s that a velocity is trusted


class TruePositionsOutput:
    """Publishes where the joints really are, at a monotonic time, while somebody listens.

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
            message = JointState(name=list(known), position=list(known.values()))
            message.header.stamp = ns_to_stamp(time.monotonic_ns())
            self._output.publish(message)


class TruePositions:
    """Listens for where simulated joints really are.

    Args:
        node: listens.
    """

    def __init__(self, node: Node) -> None:
        self._latest: tuple[int, dict[str, float], dict[str, float]] = 0, {}, {}
        node.create_subscription(JointState, _TOPIC, self._on_positions, 1)

    def now(self, joint: str) -> float | None:
        """Return where a joint is now [rad], by its latest position and velocity, or None."""
        stamp, positions, velocities = self._latest
        if joint not in positions:
            return None
        elapsed = min(1e-9 * (time.monotonic_ns() - stamp), _LONGEST)
        return positions[joint] + elapsed * velocities.get(joint, 0.0)

    def _on_positions(self, message: JointState) -> None:
        stamp_before, before, _ = self._latest
        stamp = stamp_to_ns(message.header.stamp)
        positions = dict(zip(message.name, message.position, strict=True))
        velocities = {
            joint: (where - before[joint]) / (1e-9 * (stamp - stamp_before))
            for joint, where in positions.items()
            if joint in before and stamp > stamp_before
        }
        self._latest = stamp, positions, velocities
