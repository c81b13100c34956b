"""The servo bus: all servos of one port, driven by one thread; see `cycle` and `procedures`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

from head_tracking.dynamixel.adapter import Adapter
from head_tracking.dynamixel.configuration import (
    BusSettings,
    EepromSettings,
    JointConfiguration,
    check_configuration,
)
from head_tracking.dynamixel.context import BusContext
from head_tracking.dynamixel.cycle import Cycle, advice
from head_tracking.dynamixel.exceptions import (
    BusStoppedError,
    CommunicationError,
    CorruptReplyError,
    DynamixelError,
    GoalError,
    NotConnectedError,
    ServoError,
    ServoNotFoundError,
    TorqueError,
)
from head_tracking.dynamixel.joint import Joint
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.procedures import Procedures
from head_tracking.dynamixel.requests import Epoch, RequestQueue, Steps
from head_tracking.dynamixel.servo import Changes, Servo, ServoIdentity, answering, run
from head_tracking.dynamixel.state import (
    BusReading,
    BusStatistics,
    CommandResult,
    Goal,
    Health,
    ServoStatistics,
)

_PATIENCE: Final = 0.3  # s after which silent servos are asked again, in case the machine was busy


class ServoBus:
    """Reads and drives the servos of one port.

    One thread owns the bus: it calls `connect`, `step` or the methods of `cycle`, everything that
    talks to servos, and `close` (`BusThread` is that thread). Any thread may call `command`, and
    what only looks.

    Servos start relaxed. The first command to a joint switches its torque on; after
    `switching_torque(..., False)` commands are refused until `switching_torque(..., True)`. Goals
    outside the limits never reach the wire, nor does a moving speed of 0, nor a goal for a relaxed
    servo.

    Servos that fall silent, and the adapter, may go and come back at any time: `step` goes on
    with what is there and looks for the rest.

    What takes several transactions, such as `recovering`, comes as steps: the cycles take those of
    `requests` one by one; `servo.run` takes them at once.

    Args:
        port: Where the servos are.
        joints: The joints to drive.
        clock: Time for the stamps of measurements, ns.
        monotonic: Time that never jumps, ns.
        settings: How to deal with silence, faults and heat.
        pause: Waits so many seconds, outside the cycle.
        epoch: Counts STOPs; shared with everything that is stopped together. None: its own.

    Attributes:
        cycle: Reads and writes.
        requests: What is to be done, and the goals that have not been written.

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
        settings, changes = settings or BusSettings(), Changes()
        self._joints = {
            joint.joint_name: Joint(joint, port, settings.watchdog, changes)
            for joint in check_configuration(joints)
        }
        self._all = tuple(self._joints.values())
        for joint in self._all:
            others = {s.id for other in self._all if other is not joint for s in other.servos}
            for servo in joint.servos:
                servo.others = others
        self.requests = RequestQueue(epoch or Epoch(), monotonic)
        self._bus = BusContext(
            port, self._joints, self.requests, settings, changes, clock, monotonic, pause
        )
        self._port, self._pause, self._each_servo = port, pause, self._bus.each_servo
        self._procedures = Procedures(self._bus)
        self.cycle = Cycle(self._bus, self._procedures)
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
        """Set the goals of some joints, all or none; the newest goal of a joint wins.

        The goals are written in the owner's next cycle. Speeds above a joint's `speed_limit` are
        reduced to it.

        Args:
            goals: Goal by joint name.
            clamp: For a stream of commands: move positions outside the limits to the limit, and
                leave joints out that take no commands now, instead of refusing all. One tick of
                excess always counts as being on the limit.
            claim: Gets the joints that shall move before they do; it may refuse, by raising.
            epoch: When the command was made, see `Epoch`; None: now.

        Raises:
            GoalError: A joint is unknown, a position is not finite or outside the limits, a speed
                is not finite or not above 0, or joints take no commands now. Nothing has changed.
            StoppedError: STOP came after the command was made. Nothing has changed.
            NotConnectedError: `connect` has not been called.
        """
        if not self._connected:
            self._require_connection()
        if epoch is None:
            epoch = self.requests.epoch.value
        else:
            self.requests.check(epoch)
        _, incomplete = self.cycle.absent
        positions: dict[str, float] = {}
        clamped: dict[str, float] = {}
        admitted: dict[str, Goal] = {}
        left_out: dict[str, str] = {}
        try:
            for name, goal in goals.items():
                joint = self._joints.get(name) or self.joint(name)
                if clamp and not joint.on and joint.torque.waits:
                    left_out[name] = joint.torque.value
                    continue
                position = joint.admit(goal, clamp)
                if incomplete and name in incomplete:
                    left_out[name] = "a servo of it does not answer; it is asked again all the time"
                    continue
                positions[name] = position
                if position == goal.position:
                    admitted[name] = goal
                    continue
                admitted[name] = Goal(position, goal.speed)
                if abs(position - goal.position) > joint.configuration.resolution:
                    clamped[name] = position - goal.position
            if left_out and not positions:
                reasons = "; ".join(f"{name}: {reason}" for name, reason in left_out.items())
                raise GoalError(f"command refused: {reasons}")
        except GoalError:
            self._refused += 1
            raise
        if claim is not None:
            claim(positions)
        self.requests.put_goals(admitted, epoch)
        if clamped:
            self._clamped += 1
        return CommandResult(positions, clamped, left_out)

    def joint(self, name: str) -> Joint:
        """Return a joint. Any thread may look at it, and call `set_default_speed`.

        Raises:
            GoalError: It is unknown.
        """
        try:
            return self._joints[name]
        except KeyError:
            raise GoalError(
                f"no joint {name!r} on this bus; it has {', '.join(self._joints)}"
            ) from None

    @property
    def epoch(self) -> Epoch:
        """Counts STOPs."""
        return self.requests.epoch

    @property
    def port_name(self) -> str:
        """Device that the servos are on."""
        return self._port.name

    @property
    def adapter(self) -> Adapter:
        """What is known about the device since it was opened."""
        return self._port.adapter

    @property
    def joints(self) -> tuple[JointConfiguration, ...]:
        """The configured joints."""
        return tuple(joint.configuration for joint in self._all)

    @property
    def servos(self) -> tuple[ServoIdentity, ...]:
        """What was found on the bus; empty before `connect`."""
        found = (servo.identity for _, servo in self._each_servo())
        return tuple(identity for identity in found if identity is not None)

    @property
    def summary(self) -> str:
        """A line that says what was found, such as "2 AX-12 servos: ids 1, 2"."""
        by_model: dict[str, list[str]] = {}
        for identity in self.servos:
            by_model.setdefault(identity.model, []).append(str(identity.id))
        return "; ".join(
            f"{len(ids)} {model} {'servos: ids' if len(ids) > 1 else 'servo: id'} {', '.join(ids)}"
            for model, ids in by_model.items()
        )

    def servo_name(self, joint_name: str) -> str:
        """Return what identifies the servo of a joint in another run; "" if that is not known.

        It is the adapter's name by its serial number, the servo's model and its id.
        """
        adapter, servo = self._port.stable_name, self.joint(joint_name).configuration
        return f"{Path(adapter).name} {servo.model.name} {servo.id}" if adapter else ""

    def statistics(self) -> BusStatistics:
        """Return the counters."""
        return BusStatistics(
            self.cycle.cycles,
            self._refused,
            self._clamped,
            tuple(self._servo_statistics(joint, servo) for joint, servo in self._each_servo()),
            self._connected and self._port.is_open,
            self.cycle.port_losses,
            self._port.adapter,
        )

    def _servo_statistics(self, joint: Joint, servo: Servo) -> ServoStatistics:
        identity, counters = servo.identity, servo.counters
        health = Health.FAULTED if servo.faulted else Health.PRESENT
        if joint.stopped:
            health = Health.STOPPED
        elif identity is None:
            health = Health.UNKNOWN
        elif servo.lost:
            health = Health.LOST
        elif servo.failed_cycles:
            health = Health.STALE
        known = bool(servo.stamp) and not servo.lost
        symptoms, outcome = self.cycle.diagnosis.of(servo.id)
        return ServoStatistics(
            joint_name=joint.name,
            id=servo.id,
            replies=counters.replies,
            retries=counters.retries,
            timeouts=counters.timeouts,
            corrupt=counters.corrupt,
            lost=servo.lost,
            model=servo.model.name,
            firmware_version=None if identity is None else identity.firmware_version,
            health=health,
            errors=servo.errors,
            last_stamp=servo.stamp or None,
            temperature=servo.temperature if known else None,
            voltage=servo.voltage if known else None,
            load=servo.load if known else None,
            torque=joint.torque.value,
            symptoms=symptoms,
            outcome=outcome,
        )

    # Owner's thread: connecting and closing

    def connect(self, *, allow_missing: bool = False) -> str:
        """Open the port, find all servos, relax them, and return a line that says what is there.

        Args:
            allow_missing: Go on without the servos that do not answer, and look for them.

        Returns:
            A summary such as "2 AX-12 servos: ids 1, 2".

        Raises:
            PortError: The port cannot be opened.
            ServoNotFoundError: A configured id does not answer.
            ServoError: A servo is another model, in wheel mode, silent, or does not relax.
            ConfigurationError: A servo's own angle limits leave a joint no range.
            CommunicationError: A servo answers pings, but then fails.
        """
        servos = [servo for _, servo in self._each_servo()]
        self._port.open()
        try:
            found = answering(iter(servos))
            if len(found) < len(servos):
                self._pause(_PATIENCE)
                found += answering(servo for servo in servos if servo.id not in found)
            if len(found) < len(servos) and not allow_missing:
                asked = [servo.id for servo in servos]
                raise ServoNotFoundError(asked, found, self._port.name, self._port.baud_rate)
            for servo in servos:
                if servo.id in found:
                    self._identify_at_once(servo)
                else:
                    servo.lose(0)
            for joint in self._all:
                joint.require_range()
        except BaseException:
            self._port.close()
            raise
        self.requests.drop_goals()
        self._procedures.obeyed = self.epoch.value
        self._connected = True
        for joint, servo in self._each_servo():
            self._procedures.note_shortcomings(joint, servo)
        self.cycle.begin()
        return self.summary

    def _identify_at_once(self, servo: Servo) -> None:
        try:
            run(servo.identify())
            servo.read_feedback(3)
        except CorruptReplyError as cause:
            raise CorruptReplyError(f"{cause}; {advice(servo)}") from cause

    def close(self) -> tuple[str, ...]:
        """Brake, relax every servo, close the port. Never raises for what happens on the wire.

        Returns:
            Joints that did not confirm that they are relaxed.
        """
        self.requests.end_all(BusStoppedError("the servo bus has stopped"))
        problems: Mapping[str, str] = {}
        try:
            if self._connected:
                with suppress(DynamixelError):
                    self.hold()
                    run(self._procedures.braking(), self._pause)
                problems = run(self._procedures.relax(self._all, disarm=True), self._pause)
        finally:
            self._connected = False
            self.cycle.end()
            self._port.close()
        return tuple(name for name, problem in problems.items() if problem)

    def hold(self) -> None:
        """Stop now: make the present position the goal of every joint with torque on.

        Raises:
            PortLostError: The port has gone.
            NotConnectedError: `connect` has not been called.
        """
        self._require_connection()
        self.requests.drop_goals()
        for joint in self._all:
            if joint.on:
                for servo in joint.servos:  # one that is silent gets the position read last
                    with suppress(CommunicationError):
                        if servo.answers:
                            servo.read_feedback(1 + self._bus.settings.retries)
                joint.hold()
        self.cycle.write_goals(also_silent=True)

    def step(self) -> BusReading:
        """Run one cycle; see `Cycle.read` and `Cycle.write`.

        Raises:
            NotConnectedError: `connect` has not been called.
            PortLostError: The port has gone and cannot come back under its name.
        """
        if not self._connected:
            self._require_connection()
        reading = self.cycle.read()
        events = self.cycle.write()
        return reading._replace(events=(*reading.events, *events)) if events else reading

    # Owner's thread: what takes longer than one transaction, as steps. All raise GoalError for an
    # unknown joint, and NotConnectedError before `connect`; then nothing was done.

    def switching_torque(self, joints: Iterable[str] | None, on: bool) -> Steps[None]:
        """Switch the torque of some joints, or of all (None).

        Torque on holds the present position. Torque off drops the goal; commands are refused until
        torque is switched on again. The first step switches torque off, the others confirm. Of the
        other facts, it changes none: a servo that has shut itself down needs `recovering`, a
        stopped joint `starting`, before and after.

        Raises:
            TorqueError: Some joints did not confirm; the others were switched.
        """
        chosen = self._require_connection(joints)
        for joint in chosen:  # all in the first step: who relaxes one later is heard
            if not on:
                joint.relaxed = True
            elif not (joint.stopped or joint.faulted or joint.resting):
                joint.relaxed = False
        if not on:
            yield from self._procedures.relaxing(chosen)
            return
        problems = yield from self._procedures.for_each(chosen, self._procedures.switching_on)
        if problems:
            raise TorqueError(True, problems)

    def relax_at_once(self, timeout: float, epoch: int | None = None) -> Mapping[str, str]:
        """STOP: relax all joints, whatever else is under way, and go on trying where that fails.

        Commands and requests of before are discarded. The next command switches torque on again,
        except where it was off on request; whoever stops a head refuses commands until it resumes.

        Args:
            timeout: How long servos may take to confirm, s.
            epoch: Begun by this STOP; None: it begins one.

        Returns:
            For each joint what went wrong; empty where its servos have confirmed.
        """
        self._procedures.obeyed = self.epoch.advance() if epoch is None else epoch
        deadline = self._bus.monotonic() + round(timeout * 1e9)
        self.requests.discard_older()
        steps = self._procedures.relax(self._all)
        try:
            while self._bus.monotonic() <= deadline:
                self._pause(next(steps))
            steps.close()
            late = "it has not confirmed in time"
            problems = {joint.name: "" if joint.confirmed else late for joint in self._all}
        except StopIteration as end:
            problems = end.value
        troubled = [self._joints[name] for name, problem in problems.items() if problem]
        if self._connected and troubled:
            self.requests.start(self._procedures.relaxing(troubled), despite_stop=True)
        return problems

    def recovering(
        self, joints: Iterable[str] | None = None, patience: float = 0.0
    ) -> Steps[tuple[str, ...]]:
        """Clear the faults of joints, or of all (None), and leave them relaxed.

        Protocol 1.0 servos are ready at once; others restart and are found again some cycles
        later, which `torque` tells.

        Args:
            joints: The joints.
            patience: How long to wait for servos that restart, s.

        Returns:
            The joints that had a fault.

        Raises:
            ServoError: A servo does not recover.
        """
        faulted = [joint for joint in self._require_connection(joints) if joint.faulted]
        _raise((yield from self._procedures.for_each(faulted, self._procedures.recovering)))
        deadline = self._bus.monotonic() + round(patience * 1e9)
        while patience and (waiting := [joint.name for joint in faulted if joint.faulted]):
            if self._bus.monotonic() > deadline:
                raise ServoError(f"{', '.join(waiting)}: does not recover; see /diagnostics")
            yield 0.02
        return tuple([joint.name for joint in faulted])

    def stopping(self, joints: Iterable[str] | None) -> Steps[None]:
        """Relax joints, or all (None), and take them out of the cycle until `starting`.

        Raises:
            TorqueError: Some did not confirm that they are relaxed; they are stopped all the same.
        """
        return self._procedures.relaxing(self._require_connection(joints), stop=True)

    def starting(self, joints: Iterable[str] | None) -> Steps[None]:
        """Take stopped joints, or all (None), back, relaxed and found anew.

        Raises:
            ServoError: A servo is missing, or cannot be used; it is looked for from now on.
        """
        chosen = self._require_connection(joints)
        _raise((yield from self._procedures.for_each(chosen, self._procedures.starting)))

    def writing_eeprom(
        self, joint: str, settings: EepromSettings
    ) -> Steps[dict[int, dict[str, tuple[int, int]]]]:
        """Write settings into the memory of a relaxed joint's servos, in some 0.1 s for each.

        Args:
            joint: The joint.
            settings: What they shall keep.

        Returns:
            Old and new values of what was changed, by servo id and register name.

        Raises:
            ConfigurationError: A model has no such setting; nothing was written.
            ServoError: A servo has its torque on, or does not keep a value.
            CommunicationError: A servo does not answer.
        """
        (chosen,) = self._require_connection((joint,))
        return self._procedures.exclusively(chosen, self._writing_eeprom(chosen, settings))

    def _writing_eeprom(
        self, joint: Joint, settings: EepromSettings
    ) -> Steps[dict[int, dict[str, tuple[int, int]]]]:
        wanted = {
            servo: settings.registers(servo.model, servo.calibration.tick_range)
            for servo in joint.servos
        }
        changed = {}
        self.requests.drop_goals(joint.name)
        joint.writing = True
        try:
            for servo, registers in wanted.items():
                changed[servo.id] = yield from servo.write_eeprom(registers)
            for servo in joint.servos:
                if not joint.stopped and not servo.lost:
                    yield from servo.identify()
        finally:
            joint.writing = False
        return changed

    # Helpers

    def _require_connection(self, joints: Iterable[str] | None = ()) -> list[Joint]:
        """Return some joints, or all (None), of a bus that is connected."""
        if not self._connected:
            raise NotConnectedError(f"the bus on {self._port.name} is not connected")
        if joints is None:
            return list(self._all)
        return [self.joint(name) for name in dict.fromkeys(joints)]


def _raise(problems: Mapping[str, DynamixelError]) -> None:
    if problems:
        raise ServoError("; ".join(f"{joint}: {problem}" for joint, problem in problems.items()))
