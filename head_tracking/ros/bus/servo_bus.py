"""servo_bus: the servos as joints on ROS topics."""

from __future__ import annotations

import array
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from head_tracking.configuration.bus_parameters import (
    ControllerParameters,
    MotorParameters,
    ServoBusParameters,
    TemperatureParameters,
    bus_settings,
)
from head_tracking.control import LEASE, ControlLoop, OwnershipError
from head_tracking.control.dynamixel_backend import DynamixelBackend
from head_tracking.dynamixel import (
    BusEvent,
    BusReading,
    BusStoppedError,
    DynamixelError,
    DynamixelPort,
    EepromSettings,
    EventKind,
    Goal,
    JointConfiguration,
    ServoBus,
    ServoState,
    StoppedError,
)
from head_tracking.exceptions import RefusedError
from head_tracking.ros.bus.bus_services import BusServices
from head_tracking.ros.bus.bus_status import BusStatus, bus_diagnostics, combined
from head_tracking.ros.bus.joint_configuration import declare_joint
from head_tracking.ros.kit.closing_node import ClosingNode
from head_tracking.ros.kit.diagnostics import diagnostics
from head_tracking.ros.kit.head_claim import HeadClaim
from head_tracking.ros.kit.head_lock import HeadLock
from head_tracking.ros.kit.joint_owners import OwnersOutput, sender_from
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.qos import OVERRIDABLE
from head_tracking.ros.kit.spinning import run_node, steady_timer
from head_tracking.ros.kit.stop_signal import EndRequestedError, StopSignal
from head_tracking.ros.kit.topic_output import Output

_BAD_NEWS = (
    EventKind.LOST,
    EventKind.UNUSABLE,
    EventKind.TORQUE_FAILED,
    EventKind.TORQUE_LOST,
    EventKind.FAULTED,
    EventKind.RESTING,
    EventKind.SYMPTOM,
    EventKind.PORT_LOST,
)
_SECOND = 1_000_000_000
_LOG_PERIOD = 5.0  # s
_SOMEBODY = "somebody"  # who commands without a name


class ServoBusNode(ClosingNode):
    """Publishes what the servos measure and takes commands for them.

    Args:
        connect: makes the port for these joints and names it; None: the parameter `port_name`.
            Called once for each bus.
        loop: of the process: its controllers are asked in each cycle; None: there are none.

    Raises:
        DynamixelError: the configuration can't work, a port can't be opened, or a servo does not
            answer.

    Attributes:
        backend: the servos.
        failure: what has ended a bus; None as long as all run.
    """

    def __init__(
        self,
        connect: Callable[[Sequence[JointConfiguration]], str] | None = None,
        loop: ControlLoop | None = None,
        **options: Any,
    ) -> None:
        super().__init__("servo_bus", **options)
        self.failure: BaseException | None = None
        p = NodeParameters(self, ServoBusParameters).value
        temperature = NodeParameters(self, TemperatureParameters, "temperature.").value
        self._eeprom = NodeParameters(self, EepromSettings, "eeprom.")
        self._settings = bus_settings(p, temperature)
        self._loop = loop = loop or ControlLoop(None)
        self._states: dict[ServoBus, Mapping[str, ServoState]] = {}
        self._states_output = Output(self, JointState, "servo_states")
        self._goals_output = Output(self, JointState, "joint_goals")
        self._messages: dict[ServoBus, StatesMessage] = {}
        self._reported: dict[str, float] = {}
        self._safe: list[str] | None = None
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        ports = self._declare_joints(p)
        buses = [
            ServoBus(
                DynamixelPort(
                    name if connect is None else connect(joints),
                    baud_rate,
                    reply_timeout=p.reply_timeout or None,
                ),
                joints,
                clock=lambda: int(self.get_clock().now().nanoseconds),
                settings=self._settings,
                epoch=loop.owners.epoch,
            )
            for (name, baud_rate), joints in ports.items()
        ]
        self.backend = DynamixelBackend(buses, loop, p.update_rate, self._report)
        self._baud_rates = [baud_rate for _, baud_rate in ports]
        self._connect(p.allow_missing)
        loop.attach(self.backend)
        self._create_topics()
        services = BusServices(
            self,
            self.backend,
            loop,
            lambda: self._eeprom.value,
            short_names=p.short_names,
        )
        self.closing.callback(services.close)
        self.closing.callback(self.make_safe)
        steady_timer(self, 1.0 / p.diagnostics_rate, self._publish_diagnostics)
        self._owners_output = OwnersOutput(
            self, loop.owners, [joint.joint_name for joint in self.backend.joints]
        )
        self.backend.start(self._on_reading, self._on_error)

    def servos_by_port(self) -> list[tuple[str, int, dict[int, str]]]:
        """Return port, baud rate and, by id, the models of the servos that were found on it."""
        return [
            (each.bus.port_name, baud_rate, {servo.id: servo.model for servo in each.bus.servos})
            for each, baud_rate in zip(self.backend.threads, self._baud_rates, strict=True)
        ]

    def status(self) -> BusStatus:
        """Counters, rate and the newest state of every servo that answers, of all buses."""
        return combined(self._statuses())

    def make_safe(self) -> list[str]:
        """Stops the head, relaxes the servos and closes the ports; what went wrong.

        Waits for no callback, and may be called by any thread, and twice.
        """
        if self._safe is None:
            try:
                unconfirmed = self.backend.close()
            except BusStoppedError as failure:
                problems = [str(failure)]
            else:
                problems = [f"{joint} did not confirm that it is relaxed" for joint in unconfirmed]
            self._safe = problems
            for problem in problems:
                self.get_logger().error(problem)
        return self._safe

    def _declare_joints(
        self, p: ServoBusParameters
    ) -> dict[tuple[str, int], list[JointConfiguration]]:
        """The joints of each port and baud rate."""
        ports: dict[tuple[str, int], list[JointConfiguration]] = {}
        for name in p.dynamixels:
            joint = declare_joint(
                self, name, self._on_controller, self._on_motor, self._check_motor
            )
            port = (joint.port_name or p.port_name, joint.baud_rate or p.baud_rate)
            ports.setdefault(port, []).append(joint.configuration)
        return ports

    def _connect(self, allow_missing: bool) -> None:
        log = self.get_logger()
        self.backend.connect(allow_missing=allow_missing)
        for bus in [thread.bus for thread in self.backend.threads]:
            found = f"{bus.summary or 'no servo answers'} on {bus.port_name} ({bus.adapter})"
            log.info(f"{found}; relaxed until a command comes")
            if bus.adapter.advice:
                log.warning(f"{bus.port_name}: {bus.adapter.advice}")

    def _create_topics(self) -> None:
        self.create_subscription(
            JointState,
            "joint_commands",
            self._on_joint_commands,
            1,
            qos_overriding_options=OVERRIDABLE,
        )
        self.create_subscription(JointState, "joint_claims", self._on_joint_claims, 10)
        for joint in self.backend.joints:
            name, controller = joint.joint_name, joint.controller
            self.create_subscription(
                Float64, f"{controller}/command", self._command_callback(name), 1
            )
            self.create_subscription(Float64, f"{controller}/speed", self._speed_callback(name), 1)

    def _on_reading(self, bus: ServoBus, reading: BusReading) -> None:
        """After writing, in the bus's thread."""
        for event in reading.events:
            self._log_event(event)
        self._states[bus] = states = reading.states
        if states:
            if self._states_output.wanted:
                message = self._messages.get(bus)
                if message is None or message.joints != states.keys():
                    message = self._messages[bus] = StatesMessage(states)
                self._states_output.publish(message.filled(states))
            if self._goals_output.wanted:
                self._publish_goals(states)

    def _publish_goals(self, states: Mapping[str, ServoState]) -> None:
        goals = {name: state.goal for name, state in states.items() if state.goal is not None}
        message = JointState(name=list(goals), position=list(goals.values()))
        message.header.stamp = self.get_clock().now().to_msg()
        self._goals_output.publish(message)

    def _log_event(self, event: BusEvent) -> None:
        log = self.get_logger()
        if event.repeated:
            return
        if event.kind in _BAD_NEWS:
            log.error(event.text)
        elif event.kind is EventKind.ALARM:
            log.warning(event.text)
        else:
            log.info(event.text)

    def _on_error(self, error: BaseException) -> None:
        """Called in a bus's thread when it has ended."""
        self.failure = error

    def _on_joint_claims(self, message: JointState) -> None:
        """Somebody takes joints over, whoever had them."""
        sender, epoch = sender_from(message.header.frame_id)
        known = {joint.joint_name for joint in self.backend.joints}
        if not sender or not message.name or not set(message.name) <= known:
            self.get_logger().error(
                f"joint_claims refused: {sender!r} wants {list(message.name)}; header.frame_id "
                f"must name the sender, and there are {', '.join(sorted(known))}",
                throttle_duration_sec=1.0,
            )
            return
        try:
            self._loop.owners.take_over(sender, message.name, epoch)
        except StoppedError as error:
            self._refuse(f"joint_claims of {sender}", error)

    def _on_joint_commands(self, message: JointState) -> None:
        """A stream of goals: the limits clamp it, and joints that take no commands are left out."""
        sender, epoch = sender_from(message.header.frame_id or _SOMEBODY)
        try:
            goals = goals_from_message(message)
            epoch = self._loop.owners.check(sender, goals, epoch)
            self.backend.write(sender, goals, epoch, self._claim(sender))
        except (ValueError, DynamixelError, OwnershipError) as error:
            named = f" of {sender}" if sender != _SOMEBODY else ""
            self._refuse(f"joint_commands{named}", error)

    def _claim(self, sender: str) -> Callable[[Iterable[str]], None]:
        """Claims what a command moves, for as long as commands go on."""
        return lambda joints: self._loop.owners.claim(sender, joints, LEASE)

    def _refuse(self, what: str, error: Exception) -> None:
        self.get_logger().error(f"{what} refused: {error}", throttle_duration_sec=1.0)

    def _report(self, subject: str, text: str) -> None:
        """Log what was not done as it was asked for, now and then."""
        now = time.monotonic()
        if now >= self._reported.get(subject, 0.0):
            self._reported[subject] = now + _LOG_PERIOD
            self.get_logger().warning(f"{subject}: {text}")

    def _command_callback(self, joint: str) -> Callable[[Float64], None]:
        def callback(message: Float64) -> None:
            try:
                epoch = self._loop.owners.check(_SOMEBODY, [joint])
                goal = {joint: Goal(message.data)}
                self.backend.command(goal, claim=self._claim(_SOMEBODY), epoch=epoch)
            except (DynamixelError, OwnershipError) as error:
                self.get_logger().error(f"command refused: {error}")

        return callback

    def _speed_callback(self, joint: str) -> Callable[[Float64], None]:
        def callback(message: Float64) -> None:
            try:
                self.backend.joint(joint).set_default_speed(message.data)
            except DynamixelError as error:
                self.get_logger().error(f"speed refused: {error}")

        return callback

    def _on_controller(self, joint: str, changed: ControllerParameters) -> None:
        """Called when somebody has set a speed, which has been checked."""
        self._set_limits(joint, max_speed=changed.max_speed)
        self.backend.joint(joint).set_default_speed(changed.joint_speed)

    def _on_motor(self, joint: str, changed: MotorParameters) -> None:
        """Called when somebody has set a limit, which has been checked."""
        self._set_limits(joint, lowest=changed.min, highest=changed.max)

    def _check_motor(self, joint: str, changed: MotorParameters) -> None:
        """Called when somebody wants to set a limit; raises if the servo does not allow it."""
        self.backend.joint(joint).reconfigured(changed.min, changed.max)

    def _set_limits(self, joint: str, **limits: Any) -> None:
        def done(future: Any) -> None:
            if future.exception() is not None:
                self.get_logger().error(f"{joint}: limits not set: {future.exception()}")

        (future,) = self.backend.call(
            [joint], lambda bus, _: bus.joint(joint).reconfigure(**limits), despite_stop=True
        )
        future.add_done_callback(done)

    def _statuses(self) -> list[BusStatus]:
        return [
            BusStatus(
                thread.bus.port_name,
                thread.bus.statistics(),
                thread.timing,
                self._states.get(thread.bus, {}),
                int(self.get_clock().now().nanoseconds),
                self._settings,
            )
            for thread in self.backend.threads
        ]

    def _publish_diagnostics(self) -> None:
        self._owners_output.publish()
        entries = [entry for status in self._statuses() for entry in bus_diagnostics(status)]
        self._diagnostics.publish(diagnostics(self, entries))


class StatesMessage:
    """A servo_states message that is filled anew each cycle; a new one costs nine times as much.

    The servos were read a fraction of a millisecond apart: the stamp is the middle of it. There is
    no effort: servos measure a share of their full load, which is in the diagnostics.

    Args:
        states: the joints that it tells of.
    """

    def __init__(self, states: Mapping[str, ServoState]) -> None:
        self.joints = set(states)
        self._message = JointState(name=list(states))

    def filled(self, states: Mapping[str, ServoState]) -> JointState:
        """The message, with these states."""
        message = self._message
        stamp = message.header.stamp
        each = [states[name] for name in message.name]  # whichever answered first
        total = 0
        positions, velocities = [], []
        for state in each:
            total += state.stamp
            positions.append(state.position)
            velocities.append(state.velocity)
        stamp.sec, stamp.nanosec = divmod(total // len(positions), _SECOND)
        message.position = array.array("d", positions)
        message.velocity = array.array("d", velocities)
        return message


def goals_from_message(message: JointState) -> dict[str, Goal]:
    """The goals of a joint_commands message; velocity, where given, is the speed to use.

    Raises:
        ValueError: the lists do not fit each other.
    """
    names = message.name
    speeds: Sequence[float | None] = message.velocity or [None] * len(names)
    if not names or not len(names) == len(message.position) == len(speeds):
        raise ValueError(
            f"{len(names)} names, {len(message.position)} positions and "
            f"{len(message.velocity)} velocities; name at least one joint, give each a position, "
            "and a velocity to all or none"
        )
    return {
        name: Goal(position, speed)
        for name, position, speed in zip(names, message.position, speeds, strict=True)
    }


def main() -> int:
    """Runs the node until it is interrupted; simulated heads with its names end before."""
    lock = HeadLock(sys.argv, simulated=False)
    try:
        with StopSignal() as stop:
            lock.acquire(stop.wait, shared=True)
    except EndRequestedError:
        return 0
    except RefusedError as error:
        print(error, file=sys.stderr)
        if lock.descriptors:
            return 1  # a simulated head does not end
    return run_node(_claiming_node)


def _claiming_node() -> ServoBusNode:
    """Return the node of a head that is no run, and goes on whoever else is there."""
    node = ServoBusNode()
    HeadClaim(node, simulated=False).begin()
    return node
