"""Joints moved by hand: commands for servos; without hardware, published positions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState as JointStateMsg
from std_srvs.srv import SetBool, Trigger

from head_tracking.dynamixel import Torque
from head_tracking.exceptions import HeadTrackingError
from head_tracking.page.head_modes import Mode
from head_tracking.ros.kit.diagnostics import FAULT, FaultName
from head_tracking.ros.kit.spinning import steady_timer
from head_tracking.transforms import JointState, JointStates

if TYPE_CHECKING:
    from head_tracking.page.robot import Robot

_PERIOD = 0.05  # s
_TORQUES = {torque.value for torque in Torque}
_TORQUE, _RECOVER = "/torque_enable", "/recover"


@dataclass(frozen=True, slots=True)
class JointServo:
    """The servo of a joint.

    Attributes:
        controller: prefix of its services.
        joint: the joint.
        torque: whether torque is on; None: not known.
        refuses: whether it refuses commands until torque is enabled.
        values: of its diagnostics, by name.
    """

    controller: str
    joint: str
    torque: bool | None
    refuses: bool = False
    values: Mapping[str, str] = field(default_factory=dict)


class JointPanel:
    """Moves joints and switches torque; for any thread.

    `discover` must be called in the thread of the node, or of a node beside it.
    """

    def __init__(self, node: Node, robot: Robot) -> None:
        self._node, self._robot = node, robot
        self._positions: dict[str, float] = {}
        self._is_published_by_others = True
        self._had_servos = False
        self._commands = node.create_publisher(JointStateMsg, "joint_commands", 10)
        self._states: Publisher | None = None  # while positions are published: see `discover`
        self._timer = steady_timer(node, _PERIOD, self._publish_positions)
        self._timer.cancel()

    @property
    def free(self) -> bool:
        """Whether nobody else publishes joint states, and there have never been servos."""
        if self._is_published_by_others:
            return False
        self._had_servos = self._had_servos or bool(self.servos())
        return not self._had_servos

    def discover(self) -> None:
        """Prepare to switch the servos, and find whether others publish joint states."""
        servos, buses, services = self.servos(), self._robot.stop.buses, self._robot.services
        owners = *(one.controller for one in servos), *buses
        services.know(SetBool, *(f"{owner}{_TORQUE}" for owner in owners))
        services.know(Trigger, *(f"{bus}{_RECOVER}" for bus in buses))
        self._had_servos |= bool(servos)
        publishers = self._node.count_publishers(self._node.resolve_topic_name("joint_states"))
        self._is_published_by_others = publishers > (self._states is not None)

    def servos(self) -> tuple[JointServo, ...]:
        """Return the servos whose torque can be switched, by their diagnostics.

        Of a bus that is silent they have no values: it may have ended, which ROS notices late.
        """
        base, services = self._robot.graph.namespace.rstrip("/"), self._robot.graph.services
        found = {}
        for name, values in ((one.name, one.values) for one in self._robot.topics.health()):
            controller, joint = values.get("controller"), values.get("joint", "")
            if name.partition(":")[0] not in self._robot.stop.buses or controller is None:
                continue  # a stranger may name the same servo
            if f"{base}/{controller}{_TORQUE}" not in services:
                continue
            known = {} if values.get(FAULT) == FaultName.SILENT else dict(values)
            torque = Torque(known["torque"]) if known.get("torque") in _TORQUES else None
            is_on = None if torque is None else torque is Torque.ON
            refuses = torque is not None and torque.refuses
            found[controller] = JointServo(controller, joint, is_on, refuses, known)
        return tuple(found.values())

    def move(self, positions: Mapping[str, float]) -> None:
        """Command joints of servos [rad or m]; without hardware, publish their positions.

        One message has all joints: a driver acts on the latest message only.

        Raises:
            HeadTrackingError: a joint is unknown, or is not the page's to move.
        """
        model = self._robot.buffer.model
        missing = [] if model is None else sorted(positions.keys() - model.joints.keys())
        if missing:
            raise HeadTrackingError(f"The robot has no joint {missing[0]!r}.")
        if self.free:
            self._positions.update(positions)
            if self._timer.is_canceled():  # another reset would delay the next message
                self._timer.reset()
            return
        stops = self._robot.stop.permit()
        if self._robot.modes.mode() is not Mode.OFF:
            self._robot.modes.release()
            self._robot.stop.permit(stops)
        owners = self._robot.stop.owners
        for joint in positions:
            if owners.get(joint, "") not in ("", self._node.get_name()):
                raise HeadTrackingError(f"{joint} is owned by {owners[joint]}, which keeps it.")
        message = self._message(positions)
        message.header.frame_id = self._node.get_fully_qualified_name()
        self._commands.publish(message)

    def set_torque(self, controller: str, on: bool) -> str:
        """Switch the torque of a servo, of all servos for an empty name; return the answer."""
        owners = [controller] if controller else self._buses(_TORQUE)
        if not owners:
            raise HeadTrackingError("No servo bus switches torque.")
        return "; ".join(self._robot.services.switch(f"{owner}{_TORQUE}", on) for owner in owners)

    @property
    def can_recover(self) -> bool:
        """Whether a bus offers to clear the faults of its servos."""
        return bool(self._buses(_RECOVER))

    def recover(self) -> str:
        """Clear the faults of all servos; return the answer."""
        buses = self._buses(_RECOVER)
        return "; ".join(self._robot.services.trigger(f"{bus}{_RECOVER}") for bus in buses)

    def _buses(self, service: str) -> list[str]:
        """Return the buses that offer a service by their own name: a short one may be others'."""
        offered = self._robot.services.offered
        return [bus for bus in sorted(self._robot.stop.buses) if offered(f"{bus}{service}")]

    def _publish_positions(self) -> None:
        if not self.free:
            self._timer.cancel()
            if self._states is not None:
                self._node.destroy_publisher(self._states)
                self._states = None
            return
        model = self._robot.buffer.model
        if model is None:
            return
        if self._states is None:
            self._states = self._node.create_publisher(JointStateMsg, "joint_states", 10)
        states = JointStates(model, {}, default_positions=True).complete(
            {name: JointState(position) for name, position in dict(self._positions).items()}
        )
        self._states.publish(self._message({name: one.position for name, one in states.items()}))

    def _message(self, positions: Mapping[str, float]) -> JointStateMsg:
        message = JointStateMsg(name=list(positions), position=list(map(float, positions.values())))
        message.header.stamp = self._node.get_clock().now().to_msg()
        return message
