"""What the parts of one bus share, its log of events, and its procedures.

A procedure takes several transactions with the servos of a joint; see `requests.Steps`. A joint is
busy while one runs for it, except those that relax it.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar

from head_tracking.dynamixel.configuration import BusSettings, EepromSettings
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    DynamixelError,
    ServoError,
    TorqueError,
)
from head_tracking.dynamixel.joint import BusJoint
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.requests import RequestQueue, Steps
from head_tracking.dynamixel.servo import Servo, Version
from head_tracking.dynamixel.state import BusEvent, EventKind
from head_tracking.dynamixel.torque import pin, relaxing, release, while_held_by

_T = TypeVar("_T")
POLL_INTERVAL: Final = 40_000_000  # ns between two polls of a lost servo
_BRAKING: Final = 0.6  # s that a joint may take to stop
_STANDS: Final = 0.1  # rad/s
_POLL: Final = 0.002  # s
_LONGEST_WAIT: Final = 10.0  # s for another procedure of the same joint
_REPEATS: Final = 30_000_000_000  # ns; an event that returns sooner is repeated
_STUCK: Final = (EventKind.TORQUE_FAILED, EventKind.FAULTED, EventKind.RESTING)


@dataclass(eq=False)
class Procedures:
    """What the parts of one bus share, its log of events, and its procedures."""

    port: DynamixelPort
    joints: dict[str, BusJoint]  # by name
    requests: RequestQueue
    settings: BusSettings
    version: Version  # changes with the set of servos that are read
    clock: Callable[[], int]  # of the stamps, ns
    monotonic: Callable[[], int]  # ns
    events: list[BusEvent] = field(default_factory=list)  # that have not been reported
    _recent: dict[tuple[EventKind, str, Hashable], tuple[int, int]] = field(default_factory=dict)

    def each_servo(self) -> Iterator[tuple[BusJoint, Servo]]:
        """Yield each servo with its joint."""
        return ((joint, servo) for joint in self.joints.values() for servo in joint.servos)

    def note(
        self,
        kind: EventKind,
        joint: BusJoint,
        text: str,
        stuck: bool = False,
        about: Hashable = None,
        servo: Servo | None = None,
    ) -> None:
        """Add an event.

        The second event of a kind says that it repeats; later ones are marked as repeated, until
        there was none for 30 s.

        Args:
            kind: What happened.
            joint: To which joint.
            text: The same for the log.
            stuck: Whether the joint cannot reach its goals.
            about: Distinguishes events of one kind.
            servo: Which of its servos; None: the first one stands for the joint.
        """
        who = f"{joint.name} (id {(servo or joint.servos[0]).id})"
        text = f"{who}: {text}"
        now, key = self.monotonic(), (kind, who, about)
        count, last = self._recent.get(key, (0, 0))
        count = count + 1 if now - last < _REPEATS else 1
        self._recent[key] = count, now
        if count == 2:
            text += "; repeats are not logged"
        stuck = stuck or kind in _STUCK
        self.events.append(BusEvent(kind, joint.name, text, stuck, repeated=count > 2))

    # Steps

    def begin(self, joint: BusJoint, steps: Steps[Any]) -> None:
        """Take the first step now and the others in the next cycles."""
        self.requests.advance(self.requests.start(self.exclusively(joint, steps)))

    def exclusively(self, joint: BusJoint, steps: Steps[_T]) -> Steps[_T]:
        """Take steps while no other procedure runs for this joint.

        Raises:
            ServoError: Another procedure does not end within 10 s.
        """
        for _ in range(round(_LONGEST_WAIT / _POLL)):
            if not joint.busy:
                break
            yield _POLL
        else:
            raise ServoError(f"{joint.name} is busy with another request; try again")
        joint.busy = True
        try:
            yield 0.0
            return (yield from steps)
        finally:
            joint.busy = False

    def for_each(
        self, joints: Sequence[BusJoint], steps: Callable[[BusJoint], Steps[None]]
    ) -> Steps[dict[str, DynamixelError]]:
        """Take steps for each joint; return the errors by joint."""
        problems: dict[str, DynamixelError] = {}
        for joint in joints:
            try:
                yield from self.exclusively(joint, steps(joint))
            except DynamixelError as cause:
                problems[joint.name] = cause
        return problems

    def write_goals(self, joints: Iterable[BusJoint]) -> None:
        """Write the goals of joints, in one packet for each protocol and kind of goal."""
        packets: dict[tuple[int, int, int], dict[int, bytes]] = {}
        for joint in joints:
            speed = joint.default_speed if joint.goal_speed is None else joint.goal_speed
            for servo, ticks in zip(joint.servos, joint.goal_ticks, strict=True):
                data = servo.encode_goal(ticks, speed)
                packets.setdefault(servo.goal_key, {})[servo.id] = data
        for (protocol, address, _), goals in packets.items():
            self.port.sync_write(address, goals, protocol)

    # Torque off

    def braking(self) -> Steps[None]:
        """Make the present position the goal of every joint with torque on; wait until it stops."""
        moving: list[Servo] = []
        for joint in [joint for joint in self.joints.values() if joint.on]:
            for servo in joint.servos:  # a silent one gets the position read last
                with suppress(CommunicationError):
                    if servo.answers:
                        servo.read_feedback(2)
            joint.hold()
            moving += joint.servos
        self.write_goals([joint for joint in self.joints.values() if joint.on])
        deadline = self.monotonic() + round(_BRAKING * 1e9)
        for _ in range(round(_BRAKING / _POLL)):  # in case the clock stands still
            moving = [servo for servo in moving if not (servo.lost or _stands(servo))]
            if not moving or self.monotonic() > deadline:
                return
            yield _POLL

    def relax(
        self, joints: Sequence[BusJoint], *, stop: bool = False, disarm: bool = False
    ) -> Steps[dict[str, str]]:
        """Relax joints; return by joint why it has not confirmed, empty where it has.

        The first step switches torque off, the others read it back. `stop`: take them out of the
        cycle, too, where servos that have not confirmed are asked until they answer; `disarm`:
        switch off the Bus Watchdog of their servos, too.
        """
        sure = [s for each in joints if each.stopped and each.confirmed for s in each.servos]
        for joint in joints:
            self.requests.drop_goals(joint.name)
            joint.drop_goal()
            if stop:
                joint.stopped = True
                self.version.number += 1
        servos = [servo for joint in joints for servo in joint.servos]
        try:
            found = yield from relaxing(self.port, servos, disarm=disarm, sure=sure)
        finally:
            for joint in joints:
                for servo in joint.servos:
                    if joint.stopped and not servo.confirmed:
                        servo.lose(0)
        return {
            joint.name: "; ".join(filter(None, [found[servo.id] for servo in joint.servos]))
            for joint in joints
        }

    def relaxing(
        self, joints: Sequence[BusJoint], *, stop: bool = False, quiet: bool = False
    ) -> Steps[None]:
        """Relax joints; `stop`: take them out of the cycle, too; `quiet`: report failures only.

        Raises:
            TorqueError: Some did not confirm.
        """
        found = yield from self.relax(joints, stop=stop, disarm=stop)
        kind = EventKind.STOPPED if stop else EventKind.TORQUE_OFF
        for joint in joints:
            if problem := found[joint.name]:
                self.note(EventKind.TORQUE_FAILED, joint, f"not confirmed relaxed: {problem}")
            elif not quiet:
                self.note(kind, joint, joint.torque.value)
        problems = {name: problem for name, problem in found.items() if problem}
        if problems:
            raise TorqueError(False, problems)

    def cut(self, *joints: BusJoint) -> None:
        """Switch torque off now, and read it back in the next cycles."""
        steps = self.relaxing(joints, quiet=True)
        self.requests.advance(self.requests.start(steps, despite_stop=True))

    def obey_stop(self) -> None:
        """Carry out a STOP that did not get the port."""
        self.requests.obeyed = self.requests.epoch.value
        self.requests.discard()
        self.cut(*self.joints.values())

    # Torque on. All raise ServoError or CommunicationError, and then leave the joint relaxed.

    def switching_on(self, joint: BusJoint) -> Steps[None]:
        """Hold a joint at its present position, unless it must stay relaxed."""
        holds = joint.on
        for servo in joint.servos if holds else ():
            holds = servo.get("Torque Enable") == 1 and holds
            yield 0.0
        if not (holds and joint.on):
            if joint.refusal:
                raise ServoError(joint.refusal)
            if not joint.complete:
                raise ServoError("the servo does not answer")
            yield from self._pinning(joint)
        self.note(EventKind.TORQUE_ON, joint, joint.torque.value)

    def switching_on_for_goal(self, joint: BusJoint) -> Steps[None]:
        """Switch the torque of a joint with a goal on; if that fails, relaxing drops the goal."""
        try:
            yield from self.switching_on(joint)
        except (CommunicationError, ServoError) as cause:
            self.note(EventKind.TORQUE_FAILED, joint, f"goal dropped: {cause}")

    def clear_watchdog(self, joint: BusJoint, why: str = "its Bus Watchdog tripped") -> None:
        """Hold a joint at its present position, with the watchdogs of its servos armed anew."""
        if not joint.busy:
            self.begin(joint, self._holding(joint, why))

    def _holding(self, joint: BusJoint, why: str) -> Steps[None]:
        result = "it holds its present position"
        try:
            yield from self._pinning(joint, powered=True)
        except (CommunicationError, ServoError) as cause:
            result = str(cause)
        self.note(EventKind.HELD, joint, f"{why}; {result}")

    def _pinning(self, joint: BusJoint, powered: bool = False) -> Steps[None]:
        """Switch torque on, or require it to be on (`powered`), at the present position."""
        ticks: list[int] = []
        request = object()
        for servo in joint.servos:
            servo.held_by = request
        try:
            for servo in joint.servos:
                steps = pin(servo, joint.range(servo), powered)
                ticks.append((yield from while_held_by(request, joint.servos, steps)))
        except (GeneratorExit, CommunicationError, ServoError):
            self.cut(joint)  # the goal alone may have switched torque on
            raise
        joint.pinned(ticks)

    # Faults, and servos that are lost and return

    def recovering(self, joint: BusJoint) -> Steps[None]:
        """Clear the fault of a joint.

        A protocol 1.0 servo of Dynamixel has set its Torque Limit to 0 and gets it back; others
        restart, and are lost until the bus finds them again.
        """
        if joint.lost:
            return  # it may be restarting, for another request
        problems = yield from self.relax([joint])
        for servo in joint.servos:
            if servo.faulted and not servo.lost:
                if servo.model.restarts:
                    servo.reboot()
                    servo.lose(self.monotonic())
                    continue
                if not servo.confirmed:  # it would drive on to its old goal
                    raise ServoError(f"not confirmed relaxed: {problems[joint.name]}")
                limit = servo.get("Max Torque")
                yield 0.0
                yield from servo.verify(servo.model.control_table.block("Torque Limit"), limit)
                servo.faulted = False
        result = joint.torque.value if joint.complete else "it restarts"
        self.note(EventKind.RECOVERED, joint, result)

    def returning(self, joint: BusJoint, servo: Servo) -> Steps[None]:
        """Take a servo that answers again back into the cycle."""
        try:
            result = yield from self._take_back(joint, servo)
        except (CommunicationError, ServoError, ConfigurationError) as cause:
            servo.lose(self.monotonic() + POLL_INTERVAL)
            if not isinstance(cause, CommunicationError):
                if joint.on or joint.resumes:  # its other servo may hold
                    self.cut(joint)
                else:
                    release(self.port, (servo,))
                self.note(EventKind.UNUSABLE, joint, str(cause), about=str(cause), servo=servo)
            return
        self.note(EventKind.RETURNED, joint, f"answers again; {result}", servo=servo)
        self.note_shortcomings(joint, servo)

    def _take_back(self, joint: BusJoint, servo: Servo) -> Steps[str]:
        """Identify a servo that answers again; return the state of its torque.

        If the joint was on and the servo has kept its torque, it holds its present position.
        Otherwise it is relaxed.
        """
        keep = joint.on or joint.resumes
        yield from servo.identify(keep_torque=keep)
        joint.require_range()
        keep = keep and (joint.on or joint.resumes)  # unless it was relaxed meanwhile
        if keep and servo.faulted:
            self.cut(joint)
        elif keep and not servo.confirmed:
            if not joint.complete:
                return "its other servo does not answer"
            try:
                yield from self._pinning(joint, powered=True)
            except (CommunicationError, ServoError) as cause:
                return f"relaxed, because it does not hold: {cause}"
            return "it kept its torque and holds its present position"
        elif keep and len(joint.servos) > 1:
            self.cut(joint)  # the other one may hold
            return f"it has lost its torque; {joint.torque.value}"
        joint.resumes = False
        return joint.torque.value

    def note_shortcomings(self, joint: BusJoint, servo: Servo) -> None:
        """Report a fault or missing features of a servo that was found."""
        identity, first = servo.identity, servo.model.watchdog
        if identity is None or servo.lost:
            return
        if servo.faulted:
            self.note(
                EventKind.FAULTED,
                joint,
                f"servo {servo.id} has shut itself down before; it takes no commands until "
                "recover is called",
            )
        if first is not None and self.settings.watchdog and not servo.has_watchdog:
            self.note(
                EventKind.ALARM,
                joint,
                f"servo {servo.id} has firmware {identity.firmware_version}, which has no Bus "
                f"Watchdog ({first} has): if this program dies, the servo moves on to its goal",
                about="firmware",
            )

    def writing_eeprom(
        self, joint: BusJoint, settings: EepromSettings
    ) -> Steps[dict[int, dict[str, tuple[int, int]]]]:
        """Write settings into the memory of a joint's servos; see `ServoBus.writing_eeprom`."""
        wanted = {
            servo: settings.registers(servo.model, servo.calibration.tick_range)
            for servo in joint.servos
        }
        changed = {}
        self.requests.drop_goals(joint.name)
        for servo in joint.servos:
            servo.require_writable_memory()  # before any of them has changed
            yield 0.0
        joint.writing = True
        try:
            for servo, registers in wanted.items():
                changed[servo.id] = yield from servo.write_eeprom(registers)
            for servo in joint.servos:
                yield from servo.identify()
        except BaseException:
            for servo in joint.servos:  # what has changed is read when the cycle finds it again
                servo.lose(0)
            raise
        finally:
            joint.writing = False
        return changed


def _stands(servo: Servo) -> bool:
    try:
        servo.read_feedback()
    except CommunicationError:
        return False
    return abs(servo.velocity) <= _STANDS
