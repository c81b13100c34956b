"""True positions of simulated joints, published by control for the simulated camera."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Final

from rclpy.node import Node
from sensor_msgs.msg import JointState

from head_tracking.ros.kit.spinning import steady_timer
from head_tracking.ros.kit.topics import Output
from head_tracking.tf.conversions import ns_to_stamp, stamp_to_ns

_TOPIC: Final = "true_joint_states"
_PERIOD: Final = 0.02  # s
_MAX_EXTRAPOLATION: Final = 0.05  # s


class TruePositionsOutput:
    """Publishes the true joint positions with a monotonic stamp, while somebody subscribes.

    Args:
        node: publishes.
        joints: their names.
        true_position: returns the true position of a joint [rad]; None: it is not simulated.
    """

    def __init__(
        self, node: Node, joints: Sequence[str], true_position: Callable[[str], float | None]
    ) -> None:
        self._output = Output(node, JointState, _TOPIC, 1)
        self._joints, self._true_position = joints, true_position
        steady_timer(node, _PERIOD, self._publish)

    def _publish(self) -> None:
        if self._output.wanted:
            every = {joint: self._true_position(joint) for joint in self._joints}
            known = {joint: position for joint, position in every.items() if position is not None}
            message = JointState(name=list(known), position=list(known.values()))
            message.header.stamp = ns_to_stamp(time.monotonic_ns())
            self._output.publish(message)


class TruePositions:
    """Subscribes to the true joint positions.

    Args:
        node: subscribes.
    """

    def __init__(self, node: Node) -> None:
        self._latest: tuple[int, dict[str, float], dict[str, float]] = 0, {}, {}
        node.create_subscription(JointState, _TOPIC, self._on_positions, 1)

    def now(self, joint: str) -> float | None:
        """Return the present position of a joint, extrapolated [rad]; None: not known."""
        stamp, positions, velocities = self._latest
        if joint not in positions:
            return None
        elapsed = min(1e-9 * (time.monotonic_ns() - stamp), _MAX_EXTRAPOLATION)
        return positions[joint] + elapsed * velocities.get(joint, 0.0)

    def _on_positions(self, message: JointState) -> None:
        stamp_before, before, _ = self._latest
        stamp = stamp_to_ns(message.header.stamp)
        positions = dict(zip(message.name, message.position, strict=True))
        velocities = {
            joint: (position - before[joint]) / (1e-9 * (stamp - stamp_before))
            for joint, position in positions.items()
            if joint in before and stamp > stamp_before
        }
        self._latest = stamp, positions, velocities
