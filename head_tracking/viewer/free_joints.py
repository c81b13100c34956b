"""Joints that nobody measures: a person says where they are."""

from __future__ import annotations

from collections.abc import Mapping

from rclpy.node import Node
from sensor_msgs.msg import JointState as JointStateMsg

from head_tracking.transforms import JointState, JointStates, RobotModel

_PERIOD = 0.05  # s


class FreeJoints:
    """Publishes `joint_states` as long as nobody else does, from the first position on.

    Args:
        node: publishes. `look` must be called in its thread, or in that of a node beside it.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._model: RobotModel | None = None
        self._positions: dict[str, float] = {}
        self._others_send = True
        self._servos_seen = False
        self._publisher = node.create_publisher(JointStateMsg, "joint_states", 10)
        self._timer = node.create_timer(_PERIOD, self._send)
        self._timer.cancel()

    @property
    def free(self) -> bool:
        """Whether nobody else sends joint states, and no servos were ever there."""
        return not self._others_send and not self._servos_seen

    def look(self, *, servos: bool) -> None:
        """Finds out who sends joint states now; `servos`: there are some."""
        publishers = self._node.get_publishers_info_by_topic("joint_states")
        own = self._node.get_fully_qualified_name()
        self._others_send = any(
            f"{one.node_namespace.rstrip('/')}/{one.node_name}" != own for one in publishers
        )
        self._servos_seen |= servos

    def put(self, model: RobotModel, positions: Mapping[str, float]) -> None:
        """Says where joints are [rad or m]; those of which nothing was said are at 0."""
        self._model = model
        self._positions.update(positions)
        self._timer.reset()

    def _send(self) -> None:
        if self._model is None or not self.free:
            self._timer.cancel()
            return
        states = JointStates(self._model, {}, default_positions=True).complete(
            {name: JointState(position) for name, position in self._positions.items()}
        )
        message = JointStateMsg(
            name=list(states), position=[state.position for state in states.values()]
        )
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)
