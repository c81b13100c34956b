"""servo_bus: the servos as joints on ROS topics."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import wait
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from head_tracking.configuration.bus_parameters import (
    TUTORIAL_HEAD,
    ControllerParameters,
    MotorParameters,
    SecondMotorParameters,
    ServoBusParameters,
    configured_joint,
    joints_by_port,
)
from head_tracking.control import LEASE, ControlLoop, OwnershipError
from head_tracking.control.dynamixel_backend import DynamixelBackend
from head_tracking.control.throttle import Throttle
from head_tracking.dynamixel import (
    BusEvent,
    BusReading,
    BusSettings,
    DynamixelError,
    DynamixelPort,
    EepromSettings,
    EventKind,
    Goal,
    JointConfiguration,
    ServoBus,
    ServoState,
    StoppedError,
    servo_model,
)
from head_tracking.dynamixel.configuration import TemperatureParameters, fastest_speed
from head_tracking.dynamixel.serial_port import open_serial
from head_tracking.exceptions import RefusedError
from head_tracking.ros.bus.bus_services import BusServices
from head_tracking.ros.bus.bus_status import bus_diagnostics
from head_tracking.ros.kit.diagnostics import diagnostics
from head_tracking.ros.kit.head_claim import HeadClaim, KeptStop
from head_tracking.ros.kit.head_lock import HeadLock
from head_tracking.ros.kit.joint_owners import OwnersOutput, sender_from
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.spinning import ClosingNode, check_arguments, run_node, steady_timer
from head_tracking.ros.kit.stop_signal import EndRequestedError, StopSignal
from head_tracking.ros.kit.topics import LONGEST_TEXT, OVERRIDABLE

_ERRORS = (
    EventKind.LOST,
    EventKind.UNUSABLE,
    EventKind.TORQUE_FAILED,
    EventKind.TORQUE_LOST,
    EventKind.FAULTED,
    EventKind.RESTING,
    EventKind.SYMPTOM,
    EventKind.PORT_LOST,
)
_SECOND = 1_000_000_000  # ns
_LOG_PERIOD, _REFUSAL_PERIOD = 5.0, 1.0  # s
_LIMITS_TIME = 1.0  # s that setting limits may take
_SOMEBODY = "somebody"  # the sender of commands without a name


class ServoBusNode(ClosingNode):
    """Publishes the measurements of the servos, and receives commands for them.

    Args:
        simulate: returns what opens simulated servos for joints; None: they are on serial ports.
        loop: the control loop of the process; None: a new one.

    Raises:
        DynamixelError: the configuration is not possible, a port cannot be opened, or a servo does
            not answer.

    Attributes:
        failure: the error that has ended a bus; None as long as all run.
    """

    def __init__(
        self,
        simulate: Callable[[Sequence[JointConfiguration]], Callable[[str, int], Any]] | None = None,
        loop: ControlLoop | None = None,
        **options: Any,
    ) -> None:
        super().__init__("servo_bus", **options)
        self.failure: BaseException | None = None
        p = NodeParameters(self, ServoBusParameters).value
        temperature = NodeParameters(self, TemperatureParameters, "temperature.").value
        self._eeprom = NodeParameters(self, EepromSettings, "eeprom.")
        self._settings = BusSettings(p.command_timeout, p.bus_watchdog, temperature)
        self._loop = loop = loop or ControlLoop(None)
        self._states_topic, self._goals_topic = (
            self.create_publisher(JointState, name, 10, qos_overriding_options=OVERRIDABLE)
            for name in ("servo_states", "joint_goals")
        )
        self._throttle, self._refusals = Throttle(_LOG_PERIOD), Throttle(_REFUSAL_PERIOD)
        self._safe: list[str] | None = None
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        ports = joints_by_port(p, map(self._declare_joint, p.dynamixels))
        buses = [
            ServoBus(
                DynamixelPort(
                    name if simulate is None else "simulated port",
                    baud_rate,
                    reply_timeout=p.reply_timeout or None,
                    open_device=open_serial if simulate is None else simulate(joints),
                ),
                joints,
                clock=lambda: int(self.get_clock().now().nanoseconds),
                settings=self._settings,
                epoch=loop.owners.epoch,
            )
            for name, (baud_rate, joints) in ports.items()
        ]
        self.backend = DynamixelBackend(
            buses, loop, p.update_rate, self._report, self._on_reading, self._on_error
        )
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
            self,
            loop.owners,
            [joint.joint_name for joint in self.backend.joints],
            self.backend.limits,
        )
        self.backend.start()

    def servos_by_port(self) -> list[tuple[str, int, dict[int, str]]]:
        """Return port, baud rate, and the models of the servos on it by id, of each bus."""
        return [
            (
                each.bus.port.stable_name or each.bus.port.name,
                each.bus.port.baud_rate,
                {servo.id: servo.model.name for servo in each.bus.servos},
            )
            for each in self.backend.threads
        ]

    def make_safe(self) -> list[str]:
        """Stop the head, relax the servos and close the ports; return the problems.

        Waits for no callback; may be called by any thread, and twice.
        """
        if self._safe is None:
            self._safe = self.backend.close()
            for problem in self._safe:
                self.get_logger().error(problem)
        return self._safe

    def _declare_joint(self, dynamixel: str) -> tuple[ControllerParameters, JointConfiguration]:
        """Declare the parameters of a joint, which apply new speeds and limits at once."""
        prefix = f"{dynamixel}_controller."

        def set_speeds(p: ControllerParameters) -> None:
            self._set_limits(p.joint_name, max_speed=p.max_speed)
            self.backend.joint(p.joint_name).set_default_speed(p.joint_speed)

        def check_limits(p: MotorParameters) -> None:
            self.backend.joint(joint.joint_name).reconfigured(p.min, p.max)

        def set_limits(p: MotorParameters) -> None:
            self._set_limits(joint.joint_name, lowest=p.min, highest=p.max)

        motor = NodeParameters(
            self,
            MotorParameters,
            f"{prefix}motor.",
            TUTORIAL_HEAD.get(dynamixel),
            set_limits,
            check_limits,
        ).value
        fastest = fastest_speed(servo_model(motor.model))
        controller = NodeParameters(
            self,
            ControllerParameters,
            prefix,
            {"joint_name": f"{dynamixel}_joint"},
            set_speeds,
            maxima={"joint_speed": fastest, "max_speed": fastest},
        ).value
        other = NodeParameters(self, SecondMotorParameters, f"{prefix}second_motor.").value
        joint = configured_joint(dynamixel, controller, motor, other)
        return controller, joint

    def _connect(self, allow_missing: bool) -> None:
        log = self.get_logger()
        self.backend.connect(allow_missing=allow_missing)
        for bus in [thread.bus for thread in self.backend.threads]:
            found = f"{bus.summary or 'no servo answers'} on {bus.port.name} ({bus.port.adapter})"
            log.info(f"{found}; relaxed until a command comes")
            if bus.port.adapter.advice:
                log.warning(f"{bus.port.name}: {bus.port.adapter.advice}")

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
            for topic, callback in (("command", self._on_command), ("speed", self._on_speed)):
                subject = f"{controller}/{topic}"
                self.create_subscription(Float64, subject, partial(callback, name), 1)

    def _on_reading(self, bus: ServoBus, reading: BusReading) -> None:
        """Log events and publish states, after the write, in the thread of the bus."""
        for event in reading.events:
            self._log_event(event)
        if states := reading.states:
            if self._states_topic.get_subscription_count():
                self._states_topic.publish(states_message(reading))
            if self._goals_topic.get_subscription_count():
                self._publish_goals(states)

    def _publish_goals(self, states: Mapping[str, ServoState]) -> None:
        goals = {name: state.goal for name, state in states.items() if state.goal is not None}
        message = JointState(name=list(goals), position=list(goals.values()))
        message.header.stamp = self.get_clock().now().to_msg()
        self._goals_topic.publish(message)

    def _log_event(self, event: BusEvent) -> None:
        log = self.get_logger()
        if event.repeated:
            return
        if event.kind in _ERRORS:
            log.error(event.text)
        elif event.kind is EventKind.ALARM:
            log.warning(event.text)
        else:
            log.info(event.text)

    def _on_error(self, error: BaseException) -> None:
        self.failure = error

    def _on_joint_claims(self, message: JointState) -> None:
        """Give joints to the sender, whoever owns them; it keeps them while it sends commands."""
        sender, epoch = sender_from(message.header.frame_id)
        known = {joint.joint_name for joint in self.backend.joints}
        try:
            if not sender or not message.name or not set(message.name) <= known:
                raise ValueError(
                    f"header.frame_id must be the name of the sender, and the joints are "
                    f"{', '.join(sorted(known))}; it claims {list(message.name)}"
                )
            self._loop.owners.take_over(sender, message.name, epoch, LEASE)
        except (ValueError, StoppedError, OwnershipError) as error:
            self._refuse(f"joint_claims of {sender!r}", error)

    def _on_joint_commands(self, message: JointState) -> None:
        """Set a stream of goals, within the limits, of the joints that accept commands."""
        sender, epoch = sender_from(message.header.frame_id or _SOMEBODY)
        try:
            goals = goals_from_message(message)
            epoch = self._loop.owners.check(sender, goals, epoch)
            self.backend.write(sender, goals, epoch, self._claim(sender))
        except (ValueError, DynamixelError, OwnershipError) as error:
            named = f" of {sender}" if sender != _SOMEBODY else ""
            self._refuse(f"joint_commands{named}", error)

    def _claim(self, sender: str) -> Callable[[Iterable[str]], None]:
        """Return a function that claims the joints of a command while its sender sends commands."""
        return lambda joints: self._loop.owners.claim(sender, joints, LEASE)

    def _refuse(self, what: str, error: Exception) -> None:
        """Log why a message was refused, at most once a second for each topic."""
        if self._refusals.is_due(what.partition(" of ")[0]):  # senders may have any names
            self.get_logger().error(f"{what} refused: {error}"[:LONGEST_TEXT])

    def _report(self, subject: str, text: str) -> None:
        """Log why something was not done as requested, at most every 5 s for each subject."""
        if self._throttle.is_due(subject):
            self.get_logger().warning(f"{subject}: {text}"[:LONGEST_TEXT])

    def _on_command(self, joint: str, message: Float64) -> None:
        try:
            epoch = self._loop.owners.check(_SOMEBODY, [joint])
            self.backend.command(joint, Goal(message.data), epoch, self._claim(_SOMEBODY))
        except (DynamixelError, OwnershipError) as error:
            self._refuse("command", error)

    def _on_speed(self, joint: str, message: Float64) -> None:
        try:
            self.backend.joint(joint).set_default_speed(message.data)
        except DynamixelError as error:
            self._refuse("speed", error)

    def _set_limits(self, joint: str, **limits: Any) -> None:
        """Set limits, and wait until the bus applies them."""
        (future,) = self.backend.call(
            [joint], lambda bus, _: bus.joint(joint).reconfigure(**limits), despite_stop=True
        )
        problem: object = "they will be, as soon as the bus is free"
        if wait([future], _LIMITS_TIME).done:
            problem = future.exception()
        if problem is not None:
            self.get_logger().error(f"{joint}: limits not set: {problem}")

    def _publish_diagnostics(self) -> None:
        self._owners_output.publish()
        now = int(self.get_clock().now().nanoseconds)
        entries = [
            entry
            for thread in self.backend.threads
            for entry in bus_diagnostics(
                thread.bus.statistics(), thread.timing, self._settings, now
            )
        ]
        self._diagnostics.publish(diagnostics(self, entries))


def states_message(reading: BusReading) -> JointState:
    """Return the servo_states message of a reading.

    `effort` is empty: servos measure a ratio of their full load, which is in the diagnostics.
    """
    states = reading.states.values()
    message = JointState(
        name=list(reading.states),
        position=[state.position for state in states],
        velocity=[state.velocity for state in states],
    )
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(reading.stamp, _SECOND)
    return message


def goals_from_message(message: JointState) -> dict[str, Goal]:
    """Return the goals of a joint_commands message; its velocities are the speeds to use.

    Raises:
        ValueError: the lists have different lengths.
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
    """Run the node until it is interrupted; simulated heads with its names end first."""
    check_arguments(ServoBusNode)  # before a simulated head ends
    lock = HeadLock(sys.argv, simulated=False)
    try:
        with StopSignal() as stop:
            lock.acquire(stop.wait, shared=True)
    except EndRequestedError:
        return 0
    except RefusedError as error:
        print(error, file=sys.stderr)
        if lock.descriptors:
            return 1  # (a simulated head did not end)
    kept = KeptStop(sys.argv, "servo_bus")
    code = run_node(lambda: _claiming_node(kept))
    if code == 0:
        kept.forget()
    return code


def _claiming_node(kept: KeptStop) -> ServoBusNode:
    """Return the node of a single head, which continues also beside another head."""
    loop = ControlLoop(None)
    kept.guard(loop.owners)
    node = ServoBusNode(loop=loop)
    HeadClaim(node, simulated=False).begin()
    return node
