"""Joints by hand: commands for servos; for joints that nobody measures, where they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rclpy.node import Node
from sensor_msgs.msg import JointState as JointStateMsg
from std_srvs.srv import SetBool, Trigger

from head_tracking.dynamixel import Torque
from head_tracking.page.head_modes import HeadModes, Mode, OtherNodes
from head_tracking.ros.kit.diagnostics import Health
from head_tracking.ros.kit.other_services import Outcome
from head_tracking.transforms import JointState, JointStates

_PERIOD = 0.05  # s
_TORQUES = {torque.value for torque in Torque}
_TORQUE = "/torque_enable"


@dataclass(frozen=True, slots=True)
class Servo:
    """A joint that a servo turns.

    Attributes:
        controller: its name on the bus.
        joint: the joint; empty while it is not known.
        torque: whether it holds; None if that is not known.
        refuses: whether it takes no commands before its torque is switched on.
    """

    controller: str
    joint: str
    torque: bool | None
    refuses: bool = False


class JointControl:
    """Moves joints and switches torque; for any thread, but `look`.

    Args:
        node: publishes. `look` must be called in its thread, or in that of a node beside it.
        others: the nodes that drive and own the joints.
        modes: what turns the head must let go of it first.
    """

    def __init__(self, node: Node, others: OtherNodes, modes: HeadModes) -> None:
        self._node = node
        self._services, self._topics, self._graph, self._parameters, self._buffer, self._stop = (
            others
        )
        self._modes = modes
        self._services.know(SetBool, "torque_enable")
        self._services.know(Trigger, "recover")
        self._controllers: tuple[str, ...] = ()
        self._positions: dict[str, float] = {}
        self._others_send = True
        self._servos_seen = False
        self._commands = node.create_publisher(JointStateMsg, "joint_commands", 10)
        self._states = node.create_publisher(JointStateMsg, "joint_states", 10)
        self._timer = node.create_timer(_PERIOD, self._say_positions)
        self._timer.cancel()

    @property
    def free(self) -> bool:
        """Whether nobody else sends joint states, and no servos were ever there."""
        return not self._others_send and not self._servos_seen

    @property
    def can_recover(self) -> bool:
        """Whether a bus offers to clear faults."""
        return self._services.offered("recover")

    def look(self) -> None:
        """Finds out which servos there are, and who sends joint states now."""
        base = self._graph.namespace.rstrip("/")
        found = tuple(
            sorted(
                name.removeprefix(f"{base}/").removesuffix(_TORQUE)
                for name, kind in self._graph.services.items()
                if kind == "std_srvs/srv/SetBool" and name.endswith(f"_controller{_TORQUE}")
            )
        )
        self._services.know(SetBool, *(f"{controller}{_TORQUE}" for controller in found))
        self._controllers = found
        self._servos_seen |= bool(found)
        own = self._node.get_fully_qualified_name()
        self._others_send = any(
            f"{one.node_namespace.rstrip('/')}/{one.node_name}" != own
            for one in self._node.get_publishers_info_by_topic(self._states.topic_name)
        )

    def servos(self) -> tuple[Servo, ...]:
        """The servos whose torque can be switched."""
        joints = {
            name.removesuffix(".joint_name"): str(joint)
            for name, joint in self._parameters.fixed("_controller.joint_name").items()
        }
        torque = {
            joint_of(one): Torque(one.values["torque"])
            for one in self._topics.health()
            if one.values.get("torque") in _TORQUES
        }
        found = []
        for controller in self._controllers:
            joint = joints.get(controller, "")
            known = torque.get(joint)
            holds = None if known is None else known is Torque.ON
            found.append(Servo(controller, joint, holds, known is not None and known.waits))
        return tuple(found)

    def move(self, positions: Mapping[str, float]) -> Outcome:
        """Moves joints of servos [rad or m]; without hardware, says itself where joints are.

        All go into one message: of several, whoever drives the servos takes the newest.
        """
        if self.free:
            self._positions.update(positions)
            if self._timer.is_canceled():  # another reset would put off the next message
                self._timer.reset()
            return Outcome(True, "")
        if self._stop.refusal:
            return Outcome(False, self._stop.refusal)
        said = ""
        if self._modes.mode() is not Mode.OFF:
            outcome = self._modes.release()
            if not outcome.done:
                return outcome
            said = "what turned the head was switched off to move joints by hand"
        own = self._node.get_fully_qualified_name()
        owners = self._topics.owners()
        for joint in positions:
            owner = owners.get(joint, "")
            if owner and owner != self._node.get_name():
                return Outcome(False, f"{joint} belongs to {owner} now, which has not let it go")
        message = JointStateMsg(
            name=list(positions), position=[float(position) for position in positions.values()]
        )
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.header.frame_id = own
        self._commands.publish(message)
        return Outcome(True, said)

    def set_torque(self, controller: str, on: bool) -> Outcome:
        """Lets a servo hold or go; all of them for an empty name."""
        return self._services.switch(f"{controller}{_TORQUE}" if controller else _TORQUE[1:], on)

    def recover(self) -> Outcome:
        """Clears the faults of servos, where the bus can."""
        return self._services.trigger("recover")

    def _say_positions(self) -> None:
        """Publishes `joint_states` as long as nobody else does, from the first position on."""
        model = self._buffer.model
        if model is None or not self.free:
            self._timer.cancel()
            return
        states = JointStates(model, {}, default_positions=True).complete(
            {name: JointState(position) for name, position in dict(self._positions).items()}
        )
        message = JointStateMsg(
            name=list(states), position=[state.position for state in states.values()]
        )
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._states.publish(message)


def joint_of(health: Health) -> str:
    """Return the joint that the diagnostics of a servo are about."""
    return health.name.removeprefix("servo_bus: ").partition(" (servo ")[0]
