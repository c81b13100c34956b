"""The servo bus: all servos of one serial port."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Final

from head_tracking.dynamixel.configuration import (
    BusSettings,
    EepromSettings,
    JointConfiguration,
    check_configuration,
)
from head_tracking.dynamixel.cycle import Cycle
from head_tracking.dynamixel.exceptions import (
    BusStoppedError,
    DynamixelError,
    GoalError,
    NotConnectedError,
    PortLostError,
    ServoError,
    ServoNotFoundError,
    TorqueError,
)
from head_tracking.dynamixel.joint import BusJoint, bus_joints
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.procedures import Procedures
from head_tracking.dynamixel.requests import Epoch, RequestQueue, Steps
from head_tracking.dynamixel.servo import MOST_TRIES, Servo, Version, answering, run
from head_tracking.dynamixel.state import (
    BusReading,
    BusStatistics,
    CommandResult,
    Goal,
    Health,
    ServoStatistics,
)

RESTART_TIME: Final = 3.0  # s that a servo may take to restart
_STARTING: Final = 1.5  # s that the servos of the next joint that starts may take to answer
_AGAIN: Final = 0.01  # s after which joints that have not confirmed are relaxed again
_CLOSING: Final = 0.3  # s that each joint may take to confirm at the end
_PATIENCE: Final = 0.3  # s after which servos are asked again, in case the machine was busy


class ServoBus:
    """Reads and drives the servos of one port.

    One thread owns the bus: it calls `connect`, `step`, `close` and everything that talks to servos
    (`BusThread` is that thread). Any thread may call `command` and read properties.

    Servos start relaxed. The first command to a joint switches its torque on; after
    `switching_torque(..., False)` commands are refused until `switching_torque(..., True)`. Goals
    outside the limits, goals for relaxed servos, and a goal speed of 0 are never written.

    Servos and the adapter may be unplugged and return at any time.

    Methods that return `Steps` need several transactions: pass them to `requests.add`.

    Args:
        clock: Clock of the stamps of measurements, ns.
        monotonic: Monotonic time, ns.
        settings: Limits for silence, faults and heat.
        pause: Waits a number of seconds, outside the cycle.
        epoch: Counts STOPs; shared with everything that is stopped together. None: its own.

    Attributes:
        port: Port of the servos.
        cycle: Reads and writes.
        requests: Requests, and goals that have not been written.

    Raises:
        ConfigurationError: The joints contradict each other.
    """

    def __init__(
        self,
        port: DynamixelPort,
        joints: Iterable[JointConfiguration],
        clock: Callable[[], int] = time.time_ns,
        *,
        monotonic: Callable[[], int] = time.monotonic_ns,
        settings: BusSettings | None = None,
        pause: Callable[[float], object] = time.sleep,
        epoch: Epoch | None = None,
    ) -> None:
        settings, version = settings or BusSettings(), Version()
        self._joints = bus_joints(check_configuration(joints), port, settings.watchdog, version)
        self._all = tuple(self._joints.values())
        self.requests = RequestQueue(epoch or Epoch(), monotonic)
        self._procedures = Procedures(
            port, self._joints, self.requests, settings, version, clock, monotonic
        )
        self.port, self._pause, self._each_servo = port, pause, self._procedures.each_servo
        self.cycle = Cycle(self._procedures)
        self._connected = False
        self._refused = self._clamped = 0

    # Any thread

    def command(
        self,
        goals: Mapping[str, Goal],
        *,
        clamp: bool = False,
        claim: Callable[[Iterable[str]], object] | None = None,
        epoch: int | None = None,
    ) -> CommandResult:
        """Set the goals of some joints, all or none, for the next cycle.

        Speeds above a joint's `speed_limit` are reduced to it.

        Args:
            goals: Goal by joint name.
            clamp: For a stream of commands: move positions outside the limits to the limit, and
                leave joints out that accept none now, instead of refusing all. Positions up to one
                tick outside are always moved to the limit.
            claim: Called with the joints that shall move, before they do; raises to refuse.
            epoch: In which the command was made; None: the present one.

        Raises:
            GoalError: A joint is unknown or accepts no commands now, a position is not finite or
                outside the limits, or a speed is not above 0. Nothing has changed.
            StoppedError: STOP came after the command was made. Nothing has changed.
            NotConnectedError: `connect` has not been called.
        """
        if not self._connected:
            self._require_connection()
        if epoch is None:
            epoch = self.requests.epoch.value
        else:
            self.requests.check(epoch)
        admitted: dict[str, Goal] = {}
        clamped: list[str] = []
        left_out: dict[str, str] = {}
        try:
            for name, goal in goals.items():
                joint = self._joints.get(name) or self.joint(name)
                position = joint.admit(goal, clamp)
                reason = "" if joint.goal_ticks else joint.refusal
                if not joint.complete:
                    reason = "a servo of it does not answer; the bus keeps asking it"
                if reason:
                    left_out[name] = f"{joint.configuration.controller}: {reason}"
                    continue
                admitted[name] = goal
                if position != goal.position:
                    admitted[name] = Goal(position, goal.speed)
                    if abs(position - goal.position) > joint.configuration.resolution:
                        clamped.append(name)
            if left_out and not (clamp and admitted):
                raise GoalError("; ".join(f"{name}: {why}" for name, why in left_out.items()))
        except GoalError:
            self._refused += 1
            raise
        if claim is not None:
            claim(admitted)
        self.requests.put_goals(admitted, epoch)
        if clamped:
            self._clamped += 1
        return CommandResult(admitted, clamped, left_out)

    def joint(self, name: str) -> BusJoint:
        """Return a joint; raise GoalError if it is unknown. Any thread may read it."""
        try:
            return self._joints[name]
        except KeyError:
            raise GoalError(
                f"no joint {name!r} on this bus; it has {', '.join(self._joints)}"
            ) from None

    @property
    def joints(self) -> tuple[JointConfiguration, ...]:
        """The configured joints."""
        return tuple(joint.configuration for joint in self._all)

    @property
    def servos(self) -> tuple[Servo, ...]:
        """Servos that were found; empty before `connect`."""
        return tuple(servo for _, servo in self._each_servo() if servo.identity is not None)

    @property
    def summary(self) -> str:
        """The servos that were found, such as "2 AX-12 servos: ids 1, 2"."""
        by_model: dict[str, list[str]] = {}
        for servo in self.servos:
            by_model.setdefault(servo.model.name, []).append(str(servo.id))
        return "; ".join(
            f"{len(ids)} {model} {'servos: ids' if len(ids) > 1 else 'servo: id'} {', '.join(ids)}"
            for model, ids in by_model.items()
        )

    def statistics(self) -> BusStatistics:
        """Return the counters."""
        return BusStatistics(
            self.cycle.cycles,
            self._refused,
            self._clamped,
            tuple(self._servo_statistics(joint, servo) for joint, servo in self._each_servo()),
            self._connected and self.port.is_open,
            self.cycle.port_losses,
            self.port.adapter,
            self.port.name,
        )

    def _servo_statistics(self, joint: BusJoint, servo: Servo) -> ServoStatistics:
        identity = servo.identity
        health = Health.FAULTED if servo.faulted else Health.PRESENT
        if joint.stopped:
            health = Health.STOPPED
        elif identity is None:
            health = Health.UNKNOWN
        elif servo.lost:
            health = Health.LOST
        elif servo.failed_cycles:
            health = Health.STALE
        return ServoStatistics(
            joint_name=joint.name,
            id=servo.id,
            counters=replace(servo.counters),
            controller=joint.configuration.controller,
            model=servo.model.name,
            firmware_version=None if identity is None else identity.firmware_version,
            health=health,
            errors=servo.errors,
            last_stamp=servo.stamp or None,
            temperature=servo.temperature,
            voltage=servo.voltage,
            load=servo.load,
            position=servo.position,
            velocity=servo.velocity,
            torque=joint.torque.value,
            symptoms=self.cycle.diagnosis.of(servo.id),
        )

    # Thread that owns the bus

    def connect(self, *, allow_missing: bool = False) -> str:
        """Open the port, find and relax all servos, and return `summary`.

        Where this fails, the servos that can be used are relaxed all the same.

        Args:
            allow_missing: Go on without servos that do not answer, and keep asking them.

        Raises:
            PortError: The port cannot be opened.
            ServoNotFoundError: A configured id does not answer.
            ServoError: A servo is another model, in another mode, or does not relax.
            ConfigurationError: A servo's own angle limits leave a joint no range.
            CommunicationError: A servo answers pings, but then fails.
        """
        servos = [servo for _, servo in self._each_servo()]
        self.port.open()
        for servo in servos:
            servo.identity = None  # its settings may have been changed since
        try:
            found = answering(servos)
            if len(found) < len(servos):
                self._pause(_PATIENCE)
                found += answering(servo for servo in servos if servo.id not in found)
            for servo in servos:
                if servo.id not in found:
                    servo.lose(0)
            problems = self._identify(servo for servo in servos if servo.id in found)
            if problems:
                self._pause(_PATIENCE)
                problems = self._identify(problems)
            if len(found) < len(servos) and not allow_missing:
                asked = [servo.id for servo in servos]
                raise ServoNotFoundError(asked, found, self.port)
            for problem in problems.values():
                raise problem
            for joint in self._all:
                joint.require_range()
        except BaseException:
            self.port.close()
            raise
        self.requests.drop_goals()
        self.requests.obeyed, self.requests.closed = self.requests.epoch.value, False
        self._connected = True
        for joint, servo in self._each_servo():
            self._procedures.note_shortcomings(joint, servo)
        self.cycle.begin()
        return self.summary

    def _identify(self, servos: Iterable[Servo]) -> dict[Servo, DynamixelError]:
        """Identify servos; return what is wrong with those that cannot be used."""
        problems: dict[Servo, DynamixelError] = {}
        for servo in servos:
            try:
                run(servo.identify())
                servo.read_feedback(MOST_TRIES)
            except DynamixelError as cause:
                problems[servo] = cause
        return problems

    def close(self) -> tuple[str, ...]:
        """Brake and relax every servo, and close the port; return joints that did not confirm."""
        self.requests.end_all(BusStoppedError("the servo bus has stopped"))
        problems: Mapping[str, str] = {}
        try:
            if self._connected:
                try:
                    with suppress(DynamixelError):
                        run(self._procedures.braking(), self._pause)
                finally:  # also after an interrupt
                    problems = self._relax_within(_CLOSING * len(self._all), disarm=True)
        finally:
            self._connected = False
            self.port.close()
        return tuple(name for name, problem in problems.items() if problem)

    def step(self) -> BusReading:
        """Run one cycle; see `Cycle.read` and `Cycle.write`.

        Raises:
            NotConnectedError: `connect` has not been called.
            PortLostError: The port was lost and cannot return under its name.
        """
        if not self._connected:
            self._require_connection()
        return self.cycle.write(self.cycle.read())

    # Steps. All raise GoalError for an unknown joint, and NotConnectedError before `connect`.

    def switching_torque(self, joints: Iterable[str] | None, on: bool) -> Steps[None]:
        """Switch the torque of some joints, or of all (None).

        Torque on holds the present position. Torque off drops the goal; commands are refused until
        torque is switched on again. The first step switches torque off, the others read it back. A
        servo that has shut itself down needs `recovering`, a stopped joint `starting`.

        Raises:
            TorqueError: Some joints did not confirm; the others were switched.
        """
        chosen = self._require_connection(joints)
        relaxed = [joint for joint in chosen if joint.relaxed]
        for joint in chosen:  # in the first step, so that a later request has the last word
            joint.relaxed = not on
        if not on:
            yield from self._procedures.relaxing(chosen)
            return
        try:
            problems = yield from self._procedures.for_each(chosen, self._procedures.switching_on)
        finally:  # also after STOP, or if the request is cancelled
            for joint in relaxed:
                joint.relaxed = joint.relaxed or not joint.on
        if problems:
            raise TorqueError(True, problems)

    def relax_at_once(self, timeout: float, epoch: int | None = None) -> Mapping[str, str]:
        """STOP: relax all joints; the cycles keep trying where that fails.

        Earlier commands and requests are discarded. The next command switches torque on again,
        except where it was off on request; the caller must refuse commands until `resume`.

        Args:
            timeout: How long servos may take to confirm, s.
            epoch: Begun by this STOP; None: begin one.

        Returns:
            What went wrong, by joint; empty where the servos have confirmed.
        """
        if epoch is None:
            self.requests.epoch.advance()
        self.requests.obeyed = self.requests.epoch.value
        self.requests.discard()
        return self._relax_within(timeout)

    def _relax_within(self, timeout: float, *, disarm: bool = False) -> Mapping[str, str]:
        """Relax all joints, and again those that do not confirm; return what went wrong, if so."""
        deadline = self._procedures.monotonic() + round(timeout * 1e9)
        problems = dict.fromkeys(self._joints, "it has not confirmed in time")
        steps = self._relaxing_until_confirmed(problems, disarm)
        self._pause(next(steps))  # also without any time
        while self._procedures.monotonic() <= deadline and (wait := next(steps, -1.0)) >= 0.0:
            self._pause(wait)
        steps.close()
        return {joint.name: "" if joint.confirmed else problems[joint.name] for joint in self._all}

    def _relaxing_until_confirmed(self, problems: dict[str, str], disarm: bool) -> Steps[None]:
        problems |= yield from self._procedures.relax(self._all, disarm=disarm)
        # `disarm` is for the end, where a lost port, such as one with a loose plug, is waited for
        while (disarm or self.port.is_open) and (left := [j for j in self._all if not j.confirmed]):
            yield _AGAIN
            with suppress(PortLostError):
                if self.port.is_open or self.cycle.find_port():
                    problems |= yield from self._procedures.relax(left, disarm=disarm)

    def recovering(
        self, joints: Iterable[str] | None = None, patience: float = 0.0
    ) -> Steps[tuple[str, ...]]:
        """Clear the faults of joints, or of all (None), leave them relaxed; return those with one.

        Protocol 1.0 servos of Dynamixel are ready at once; others restart, which is waited for
        `patience` seconds at most for each. So is a servo that does not answer.

        Raises:
            ServoError: A servo does not recover.
        """
        faulted = [joint for joint in self._require_connection(joints) if joint.faulted]
        problems = yield from self._procedures.for_each(faulted, self._procedures.recovering)
        if problems:
            raise ServoError("; ".join(f"{joint}: {why}" for joint, why in problems.items()))
        if patience:
            yield from self._until(faulted, lambda joint: not joint.faulted, patience)
        return tuple([joint.name for joint in faulted])

    def _until(
        self, joints: Iterable[BusJoint], is_done: Callable[[BusJoint], bool], patience: float
    ) -> Steps[None]:
        """Wait until a condition holds for all joints, and no procedure runs for them.

        Raises:
            ServoError: After `patience`, s, in which it came to hold for no other joint.
        """
        fewest, deadline = len(self._all) + 1, 0
        while waiting := [joint.name for joint in joints if joint.busy or not is_done(joint)]:
            now = self._procedures.monotonic()
            if len(waiting) < fewest:
                fewest, deadline = len(waiting), now + round(patience * 1e9)
            if now > deadline:
                raise ServoError(f"{', '.join(waiting)}: cannot be used yet; see /diagnostics")
            yield 0.02

    def stopping(self, joints: Iterable[str] | None) -> Steps[None]:
        """Relax joints, or all (None), and take them out of the cycle until `starting`.

        Raises:
            TorqueError: Some did not confirm that they are relaxed; they are stopped all the same.
        """
        return self._procedures.relaxing(self._require_connection(joints), stop=True)

    def starting(self, joints: Iterable[str] | None) -> Steps[None]:
        """Take stopped joints, or all (None), back into the cycle, relaxed, as if they returned.

        Raises:
            ServoError: A servo is missing or cannot be used; the bus keeps asking it.
        """
        chosen = self._require_connection(joints)
        for joint in chosen:
            if joint.stopped:
                for servo in joint.servos:
                    servo.lose(0)
                joint.stopped = False
        yield from self._until(chosen, lambda joint: joint.complete, _STARTING)

    def writing_eeprom(
        self, joint: str, settings: EepromSettings
    ) -> Steps[dict[int, dict[str, tuple[int, int]]]]:
        """Write settings into the memory of a relaxed joint's servos, which takes about 0.1 s each.

        Returns:
            Old and new values of what was changed, by servo id and register name.

        Raises:
            ConfigurationError: A model has no such setting; nothing was written.
            ServoError: A servo has its torque on, or does not keep a value.
            CommunicationError: A servo does not answer.
        """
        (chosen,) = self._require_connection((joint,))
        steps = self._procedures.writing_eeprom(chosen, settings)
        return self._procedures.exclusively(chosen, steps)

    def _require_connection(self, joints: Iterable[str] | None = ()) -> list[BusJoint]:
        """Return some joints, or all (None), of a bus that is connected."""
        if not self._connected:
            raise NotConnectedError(f"the bus on {self.port.name} is not connected")
        if joints is None:
            return list(self._all)
        return [self.joint(name) for name in dict.fromkeys(joints)]
