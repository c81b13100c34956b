"""servo_bus: the servos as joints on ROS topics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from head_tracking.dynamixel import (
    BusEvent,
    BusReading,
    BusThread,
    DynamixelError,
    DynamixelPort,
    EventKind,
    Goal,
    JointConfiguration,
    ServoBus,
    ServoState,
    Torque,
    check_configuration,
)
from head_tracking.nodes.conversions import goals_from_message, servo_states_message
from head_tracking.nodes.diagnostics import BusStatus, bus_diagnostics
from head_tracking.nodes.joint_configuration import declare_joint
from head_tracking.nodes.parameters import NodeParameters
from head_tracking.nodes.spinning import run_node
from head_tracking.parameters import parameter

_TORQUE_TIMEOUT = 2.0  # s


@dataclass(frozen=True, slots=True)
class ServoBusParameters:
    """The port and who is on it."""

    port_name: str = parameter("/dev/ttyUSB0", "Serial port of the bus.", fixed=True)
    baud_rate: int = parameter(
        1_000_000, "Speed of the bus.", unit="bit/s", minimum=9600, maximum=4_500_000, fixed=True
    )
    update_rate: float = parameter(
        50.0, "Bus cycles per second.", unit="Hz", minimum=1.0, maximum=1000.0, fixed=True
    )
    diagnostics_rate: float = parameter(
        1.0, "Diagnostics per second.", unit="Hz", minimum=0.1, maximum=50.0, fixed=True
    )
    reply_timeout: float = parameter(
        0.025,
        "How long to wait for a servo's answer.",
        unit="s",
        minimum=0.001,
        maximum=1.0,
        fixed=True,
    )
    dynamixels: tuple[str, ...] = parameter(
        ("head_pan", "head_tilt"), "The servos; X is described by X_controller.*.", fixed=True
    )


class ServoBusNode(Node):
    """Publishes what the servos measure and takes commands for them.

    Args:
        connect: makes the port for these joints and names it; None: the parameter `port_name`.

    Raises:
        DynamixelError: the configuration can't work, the port can't be opened, or a servo does
            not answer.
    """

    def __init__(
        self,
        connect: Callable[[Sequence[JointConfiguration]], str] | None = None,
        **options: Any,
    ) -> None:
        super().__init__("servo_bus", **options)
        p = NodeParameters(self, ServoBusParameters).value
        joints = [declare_joint(self, name, self._on_speed) for name in p.dynamixels]
        check_configuration(joints)
        self._port_name = p.port_name if connect is None else connect(joints)
        self._bus = ServoBus(
            DynamixelPort(self._port_name, p.baud_rate, reply_timeout=p.reply_timeout),
            joints,
            clock=lambda: int(self.get_clock().now().nanoseconds),
        )
        self._thread = BusThread(self._bus, p.update_rate, self._on_reading, self._on_error)
        self._states: dict[str, ServoState] = {}
        self._failure: BaseException | None = None
        self._failed = self.create_guard_condition(self._on_failure)
        self._state_publisher = self.create_publisher(JointState, "servo_states", 10)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        summary = self._bus.connect()
        self.get_logger().info(f"{summary} on {self._port_name}; relaxed until a command comes")
        self._create_interfaces()
        self.create_timer(1.0 / p.diagnostics_rate, self._publish_diagnostics)
        self._thread.start()

    @property
    def joints(self) -> tuple[JointConfiguration, ...]:
        """The joints and the servos that drive them."""
        return self._bus.joints

    def status(self) -> BusStatus:
        """Counters, rate and the newest state of every servo that answers."""
        return BusStatus(self._port_name, self._bus.statistics(), self._thread.timing, self._states)

    def destroy_node(self) -> None:
        """Stops the head, relaxes the servos and closes the port."""
        self._thread.stop()
        for joint in self._thread.unconfirmed:
            self.get_logger().error(f"{joint} did not confirm that it is relaxed")
        super().destroy_node()

    def _create_interfaces(self) -> None:
        self.create_subscription(JointState, "joint_commands", self._on_joint_commands, 1)
        for joint in self._bus.joints:
            name, controller = joint.joint_name, joint.controller
            self.create_subscription(
                Float64, f"{controller}/command", self._command_callback(name), 1
            )
            self.create_subscription(Float64, f"{controller}/speed", self._speed_callback(name), 1)
            self.create_service(
                SetBool, f"{controller}/torque_enable", self._torque_callback((name,))
            )
        self.create_service(SetBool, "torque_enable", self._torque_callback(None))
        self.create_service(Trigger, "relax", self._on_relax)

    def _on_reading(self, reading: BusReading) -> None:
        """Called in the bus's thread."""
        self._states = dict(reading.states)
        for event in reading.events:
            self._log_event(event)
        if reading.states:
            self._state_publisher.publish(servo_states_message(reading.states.values()))

    def _log_event(self, event: BusEvent) -> None:
        if event.kind in (EventKind.LOST, EventKind.UNUSABLE, EventKind.TORQUE_FAILED):
            self.get_logger().error(event.text)
        else:
            self.get_logger().info(event.text)

    def _on_error(self, error: BaseException) -> None:
        """Called in the bus's thread when it has ended."""
        self._failure = error
        self._failed.trigger()

    def _on_failure(self) -> None:
        if self._failure is not None:
            raise self._failure

    def _on_joint_commands(self, message: JointState) -> None:
        """A stream of goals: the limits clamp it, and joints relaxed on request are left out."""
        log = self.get_logger()
        try:
            goals = goals_from_message(message)
        except ValueError as error:
            log.error(f"joint_commands refused: {error}", throttle_duration_sec=1.0)
            return
        relaxed = [
            joint.joint_name
            for joint in self._bus.joints
            if joint.joint_name in goals
            and self._bus.torque(joint.joint_name) is Torque.OFF_ON_REQUEST
        ]
        if relaxed:
            log.warning(
                f"{', '.join(relaxed)}: relaxed on request, so joint_commands does nothing; call "
                "torque_enable with data: true",
                throttle_duration_sec=5.0,
            )
        goals = {name: goal for name, goal in goals.items() if name not in relaxed}
        try:
            result = self._bus.command(goals, clamp=True)
        except DynamixelError as error:
            log.error(f"joint_commands refused: {error}", throttle_duration_sec=1.0)
            return
        for name in result.clamped:
            log.warning(
                f"{name}: the goal {goals[name].position:.3f} rad is beyond the servo's limit; "
                f"{result.positions[name]:.3f} rad is used",
                throttle_duration_sec=5.0,
            )

    def _command_callback(self, joint: str) -> Callable[[Float64], None]:
        def callback(message: Float64) -> None:
            try:
                self._bus.command({joint: Goal(message.data)})
            except DynamixelError as error:
                self.get_logger().error(f"command refused: {error}")

        return callback

    def _speed_callback(self, joint: str) -> Callable[[Float64], None]:
        return lambda message: self._on_speed(joint, message.data)

    def _on_speed(self, joint: str, speed: float) -> None:
        try:
            self._bus.set_speed(joint, speed)
        except DynamixelError as error:
            self.get_logger().error(f"speed refused: {error}")

    def _torque_callback(
        self, joints: tuple[str, ...] | None
    ) -> Callable[[SetBool.Request, SetBool.Response], SetBool.Response]:
        def callback(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
            response.success, response.message = self._set_torque(joints, request.data)
            return response

        return callback

    def _on_relax(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = self._set_torque(None, False)
        return response

    def _set_torque(self, joints: tuple[str, ...] | None, on: bool) -> tuple[bool, str]:
        future = self._thread.call(lambda bus: bus.set_torque(joints, on))
        try:
            future.result(_TORQUE_TIMEOUT)
        except DynamixelError as error:
            return False, str(error)
        except TimeoutError:
            return False, f"the bus did not answer within {_TORQUE_TIMEOUT} s"
        named = joints or tuple(joint.joint_name for joint in self._bus.joints)
        return True, f"{', '.join(named)}: {'torque on' if on else 'relaxed'}"

    def _publish_diagnostics(self) -> None:
        message = bus_diagnostics(self.status())
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)


def main() -> int:
    """Runs the node until it is interrupted."""
    return run_node(ServoBusNode)


if __name__ == "__main__":
    raise SystemExit(main())
