"""Joints whose servo bus runs in another process, as the backend of a control loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.client import Client
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from head_tracking.control import ControlLoop, JointBackend
from head_tracking.dynamixel import Goal
from head_tracking.ros.kit.joint_owners import control_from_message, sender
from head_tracking.ros.kit.spinning import steady_timer
from head_tracking.ros.kit.topics import LATCHED, OVERRIDABLE

_STOP_PERIOD = 0.1  # s


class JointTopics(JointBackend):
    """A `JointBackend`: publishes `joint_commands`, and adopts STOP and owners of the servo bus.

    Args:
        node: controls the head.
        name: its name as an owner.
        joints: pan and tilt.
        loop: of the process.
    """

    def __init__(self, node: Node, name: str, joints: Sequence[str], loop: ControlLoop) -> None:
        self._node = node
        self._name = name
        self._joints = tuple(joints)
        self._loop = loop
        self._commands = node.create_publisher(
            JointState, "joint_commands", 1, qos_overriding_options=OVERRIDABLE
        )
        self._claims = node.create_publisher(JointState, "joint_claims", 10)
        self._limits: dict[str, tuple[float, float]] = {}
        self._stop: Client | None = None
        self._stopping = steady_timer(node, _STOP_PERIOD, self._stop_again)
        self._stopping.cancel()

    def start(self) -> None:
        """Subscribe to the servo bus; see `JointBackend`."""
        self._node.create_subscription(DiagnosticStatus, "joint_control", self._on_control, LATCHED)

    def write(self, owner: str, goals: Mapping[str, Goal], epoch: int) -> None:
        """Publish goals; the servo bus discards them if their epoch is over."""
        message = JointState(
            name=list(goals),
            position=[goal.position for goal in goals.values()],
            velocity=[goal.speed or 0.0 for goal in goals.values()],
        )
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.header.frame_id = sender(owner, epoch)
        self._commands.publish(message)

    def limits(self, joint: str) -> tuple[float, float]:
        """Return the limits that the servo bus has published; see `JointBackend`."""
        return self._limits.get(joint, super().limits(joint))

    def claim(self) -> None:
        """See `JointBackend`."""
        message = JointState(name=list(self._joints))
        message.header.frame_id = sender(self._name, self._loop.owners.epoch.value)
        self._claims.publish(message)

    def relax_now(self) -> Mapping[str, str]:
        """Return that only the servo bus can relax; see `JointBackend`."""
        return dict.fromkeys(self._joints, "the servo bus is another process: call its `stop`")

    def _on_control(self, message: DiagnosticStatus) -> None:
        try:
            control = control_from_message(message)
        except ValueError as error:
            self._node.get_logger().error(
                f"joint_control is not used: {error}", throttle_duration_sec=1.0
            )
            return
        self._limits |= control.limits
        if self._loop.owners.follow(control.stopped, control.epoch, control.owners):
            self._stopping.cancel()
        elif self._stopping.is_canceled():
            self._node.get_logger().warning(
                "the servo bus was restarted without its STOP: stopping it"
            )
            self._stop = self._node.create_client(Trigger, control.service("stop"))
            self._stopping.reset()

    def _stop_again(self) -> None:
        """Call `stop` repeatedly, until the servo bus reports that it is stopped."""
        assert self._stop is not None
        self._stop.call_async(Trigger.Request())
