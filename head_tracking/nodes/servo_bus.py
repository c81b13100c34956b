"""servo_bus: the servos as joints on ROS topics."""

from __future__ import annotations

import array
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from head_tracking.configuration.bus_parameters import (
    ControllerParameters,
    EepromParameters,
    MotorParameters,
    ServoBusParameters,
    TemperatureParameters,
    bus_settings,
)
from head_tracking.control import LEASE, ControlLoop, OwnershipError
from head_tracking.dynamixel import (
    Buses,
    BusEvent,
    BusReading,
    BusStoppedError,
    DynamixelError,
    DynamixelPort,
    EventKind,
    Goal,
    JointConfiguration,
    ServoBus,
    ServoState,
    StoppedError,
    Torque,
)
from head_tracking.exceptions import RefusedError
from head_tracking.ros.bus_services import BusServices
from head_tracking.ros.bus_status import BusStatus, bus_diagnostics, combined
from head_tracking.ros.diagnostics import in_namespace
from head_tracking.ros.head_claim import HeadClaim
from head_tracking.ros.head_lock import HeadLock
from head_tracking.ros.joint_configuration import declare_joint
from head_tracking.ros.joint_owners import OwnersOutput, sender_from
from head_tracking.ros.output import Output
from head_tracking.ros.parameters import NodeParameters
from head_tracking.ros.spinning import run_node, steady_timer
from head_tracking.ros.stop_signal import StoppedError as StoppedBeforeStartError
from head_tracking.ros.stop_signal import StopSignal

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
_SOMEBODY = "somebody"  # who commands without a name


class ServoBusNode(Node):
    """Publishes what the servos measure and takes commands for them: a `JointBackend`.

    Args:
        connect: makes the port for these joints and names it; None: the parameter `port_name`.
            Called once for each bus.
        loop: of the process: its controllers are asked in each cycle; None: there are none.

    Raises:
        DynamixelError: the configuration can't work, a port can't be opened, or a servo does not
            answer.

    Attributes:
        failure: what has ended a bus; None as long as all run.
        period: of a cycle [s].
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
        self._eeprom = NodeParameters(self, EepromParameters, "eeprom.")
        self._settings = bus_settings(p, temperature)
        self._loop = loop = loop or ControlLoop(None)
        self._states: dict[ServoBus, Mapping[str, ServoState]] = {}
        self._states_output = Output(self, JointState, "servo_states")
        self._goals_output = Output(self, JointState, "joint_goals")
        self._messages: dict[ServoBus, StatesMessage] = {}
        self._read: dict[ServoBus, tuple[int, Mapping[str, Any]]] = {}
        self._safe: list[str] | None = None
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        ports = self._declare_joints(p)
        buses = [
            self._make_bus(joints, p, name if connect is None else connect(joints), baud_rate)
            for (name, baud_rate), joints in ports.items()
        ]
        self._buses = Buses(buses, p.update_rate, self._on_reading, self._on_error, self._update)
        self._baud_rates = [baud_rate for _, baud_rate in ports]
        self._names = {bus: frozenset([joint.joint_name for joint in bus.joints]) for bus in buses}
        self._connect(p.allow_missing)
        self.period = 1.0 / p.update_rate
        loop.attach(self)
        self._create_topics()
        self._bus_services = BusServices(
            self,
            self._buses,
            loop.owners,
            lambda: self._eeprom.value.settings,
            loop.stop,
            self.resume,
            short_names=p.short_names,
        )
        steady_timer(self, 1.0 / p.diagnostics_rate, self._publish_diagnostics)
        self._owners_output = OwnersOutput(
            self, loop.owners, [joint.joint_name for joint in self.joints]
        )
        self._buses.start()

    @property
    def joints(self) -> tuple[JointConfiguration, ...]:
        """The joints and the servos that drive them."""
        return self._buses.joints

    def servos_by_port(self) -> list[tuple[str, int, dict[int, str]]]:
        """Return port, baud rate and, by id, the models of the servos that were found on it."""
        return [
            (each.bus.port_name, baud_rate, {servo.id: servo.model for servo in each.bus.servos})
            for each, baud_rate in zip(self._buses.threads, self._baud_rates, strict=True)
        ]

    def status(self) -> BusStatus:
        """Counters, rate and the newest state of every servo that answers, of all buses."""
        return combined(self._statuses())

    def stop(self) -> Mapping[str, str]:
        """STOP, for any thread; see `ControlLoop`. Whatever else hangs, it does not wait for it."""
        return self._loop.stop()

    def relax_now(self) -> Mapping[str, str]:
        """See `JointBackend`."""
        return self._buses.relax_at_once()

    def claim(self) -> None:
        """See `JointBackend`; the owners of this process are the servo bus's."""

    def write(self, owner: str, goals: Mapping[str, Goal], epoch: int) -> None:
        """See `JointBackend`."""
        self._write(owner, goals, epoch)

    def resume(self) -> tuple[str, ...]:
        """End a STOP: hold what was not relaxed on request; return the controllers that go on.

        Raises:
            StoppedError: there was another STOP meanwhile.
        """
        owners = self._loop.owners
        epoch = owners.epoch.value
        if not owners.stopped:
            return ()
        resumed = owners.resume(epoch)
        holding = [
            joint.joint_name
            for joint in self.joints
            if self._buses.torque(joint.joint_name) is Torque.OFF_UNTIL_COMMANDED
        ]
        futures: list[Future[None]] = self._buses.call(
            holding, lambda bus, share: bus.switching_torque(share, True), epoch
        )
        for future in futures:
            future.add_done_callback(self._torque_done)
        return resumed

    def _torque_done(self, future: Future[None]) -> None:
        error = None if future.cancelled() else future.exception()
        if error is not None:
            self.get_logger().error(f"after resume: {error}")

    def destroy_node(self) -> None:
        """Stops the head, relaxes the servos and closes the ports."""
        self.make_safe()
        self._bus_services.close()
        super().destroy_node()

    def make_safe(self) -> list[str]:
        """Stops the head, relaxes the servos and closes the ports; what went wrong.

        Waits for no callback, and may be called by any thread, and twice.
        """
        if self._safe is None:
            problems: list[str] = []
            try:
                self._buses.stop()
            except BusStoppedError as failure:
                problems.append(str(failure))
            problems += [
                f"{joint} did not confirm that it is relaxed" for joint in self._buses.unconfirmed
            ]
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

    def _make_bus(
        self,
        joints: Sequence[JointConfiguration],
        p: ServoBusParameters,
        port_name: str,
        baud_rate: int,
    ) -> ServoBus:
        return ServoBus(
            DynamixelPort(port_name, baud_rate, reply_timeout=p.reply_timeout or None),
            joints,
            clock=lambda: int(self.get_clock().now().nanoseconds),
            settings=self._settings,
            epoch=self._loop.owners.epoch,
        )

    def _connect(self, allow_missing: bool) -> None:
        log = self.get_logger()
        connected: list[ServoBus] = []
        try:
            for bus in [thread.bus for thread in self._buses.threads]:
                summary = bus.connect(allow_missing=allow_missing) or "no servo answers"
                connected.append(bus)
                adapter = bus.adapter
                log.info(f"{summary} on {bus.port_name} ({adapter}); relaxed until a command comes")
                if adapter.advice:
                    log.warning(f"{bus.port_name}: {adapter.advice}")
        except BaseException:
            for bus in connected:
                bus.close()
            raise

    def _create_topics(self) -> None:
        self.create_subscription(JointState, "joint_commands", self._on_joint_commands, 1)
        self.create_subscription(JointState, "joint_claims", self._on_joint_claims, 10)
        for joint in self._buses.joints:
            name, controller = joint.joint_name, joint.controller
            self.create_subscription(
                Float64, f"{controller}/command", self._command_callback(name), 1
            )
            self.create_subscription(Float64, f"{controller}/speed", self._speed_callback(name), 1)

    def _update(self, bus: ServoBus, reading: BusReading) -> None:
        """Between reading and writing, in the bus's thread."""
        states = reading.states
        self._loop.stuck.update({e.joint_name: e.text for e in reading.events if e.stuck})
        self._states[bus] = states
        complete: Mapping[str, Any] = {}
        if states:
            stamp = sum([state.stamp for state in states.values()]) // len(states)
            complete = self._loop.joints_read(stamp, states)
            self._read[bus] = stamp, complete
        self._loop.update(self._names[bus])

    def _on_reading(self, bus: ServoBus, reading: BusReading) -> None:
        """After writing, in the bus's thread."""
        if reading.events:
            for event in reading.events:
                self._log_event(event)
        states = reading.states
        if states:
            if self._states_output.wanted:
                message = self._messages.get(bus)
                if message is None or message.joints != states.keys():
                    message = self._messages[bus] = StatesMessage(states)
                self._states_output.publish(message.filled(states))
            if self._goals_output.wanted:
                self._publish_goals(states)
        self._loop.publish(self._names[bus], *self._read.pop(bus, (0, {})))

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
        known = {joint.joint_name for joint in self._buses.joints}
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
            for name in goals:
                self._buses.torque(name)
            epoch = self._loop.owners.check(sender, goals, epoch)
            self._write(sender, goals, epoch, self._claim(sender))
        except (ValueError, DynamixelError, OwnershipError) as error:
            named = f" of {sender}" if sender != _SOMEBODY else ""
            self._refuse(f"joint_commands{named}", error)

    def _claim(self, sender: str) -> Callable[[Iterable[str]], None]:
        """Claims what a command moves, for as long as commands go on."""
        return lambda joints: self._loop.owners.claim(sender, joints, LEASE)

    def _refuse(self, what: str, error: Exception) -> None:
        self.get_logger().error(f"{what} refused: {error}", throttle_duration_sec=1.0)

    def _write(
        self,
        sender: str,
        goals: Mapping[str, Goal],
        epoch: int,
        claim: Callable[[Iterable[str]], object] | None = None,
    ) -> None:
        """Command goals of an owner, or of one that may claim the joints, made in an epoch."""
        waiting = [name for name in goals if self._buses.torque(name).waits]
        if waiting:
            for name in waiting:
                self.get_logger().warning(
                    f"{name}: {self._buses.torque(name).value}; the commands of {sender} do "
                    "nothing until then (torque_enable, start or recover, as the case may be)",
                    throttle_duration_sec=5.0,
                )
            goals = {name: goal for name, goal in goals.items() if name not in waiting}
            if not goals:
                return
        try:
            result = self._buses.command(goals, clamp=True, claim=claim, epoch=epoch)
        except DynamixelError as error:
            self._refuse("joint_commands", error)
            return
        for name in result.clamped:
            self.get_logger().warning(
                f"{name}: the goal {goals[name].position:.3f} rad is beyond the servo's limit; "
                f"{result.positions[name]:.3f} rad is used",
                throttle_duration_sec=5.0,
            )

    def _command_callback(self, joint: str) -> Callable[[Float64], None]:
        def callback(message: Float64) -> None:
            try:
                epoch = self._loop.owners.check(_SOMEBODY, [joint])
                goal = {joint: Goal(message.data)}
                self._buses.command(goal, claim=self._claim(_SOMEBODY), epoch=epoch)
            except (DynamixelError, OwnershipError) as error:
                self.get_logger().error(f"command refused: {error}")

        return callback

    def _speed_callback(self, joint: str) -> Callable[[Float64], None]:
        def callback(message: Float64) -> None:
            try:
                self._buses.bus_of(joint).set_speed(joint, message.data)
            except DynamixelError as error:
                self.get_logger().error(f"speed refused: {error}")

        return callback

    def _on_controller(self, joint: str, changed: ControllerParameters) -> None:
        """Called when somebody has set a speed, which has been checked."""
        self._set_limits(joint, max_speed=changed.max_speed)
        self._buses.bus_of(joint).set_speed(joint, changed.joint_speed)

    def _on_motor(self, joint: str, changed: MotorParameters) -> None:
        """Called when somebody has set a limit, which has been checked."""
        self._set_limits(joint, lowest=changed.min, highest=changed.max)

    def _check_motor(self, joint: str, changed: MotorParameters) -> None:
        """Called when somebody wants to set a limit; raises if the servo does not allow it."""
        self._buses.bus_of(joint).check_limits(joint, changed.min, changed.max)

    def _set_limits(self, joint: str, **limits: Any) -> None:
        def done(future: Any) -> None:
            if future.exception() is not None:
                self.get_logger().error(f"{joint}: limits not set: {future.exception()}")

        (future,) = self._buses.call(
            [joint], lambda bus, _: bus.set_limits(joint, **limits), despite_stop=True
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
            for thread in self._buses.threads
        ]

    def _publish_diagnostics(self) -> None:
        self._owners_output.publish()
        message = DiagnosticArray(
            status=[entry for status in self._statuses() for entry in bus_diagnostics(status)]
        )
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(in_namespace(self, message))


class StatesMessage:
    """A servo_states message that is filled anew each cycle; a new one costs nine times as much.

    The servos were read a fraction of a millisecond apart: the stamp is the middle of it. Effort is
    the share of full torque, -1 to 1.

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
        positions, velocities, efforts = [], [], []
        for state in each:
            total += state.stamp
            positions.append(state.position)
            velocities.append(state.velocity)
            efforts.append(state.load)
        stamp.sec, stamp.nanosec = divmod(total // len(positions), _SECOND)
        message.position = array.array("d", positions)
        message.velocity = array.array("d", velocities)
        message.effort = array.array("d", efforts)
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
    except StoppedBeforeStartError:
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


if __name__ == "__main__":
    raise SystemExit(main())
