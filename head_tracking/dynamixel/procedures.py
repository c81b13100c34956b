"""What takes several transactions with the servos of a joint, as steps; see `requests.Steps`.

The bus spreads steps over its cycles. A joint is busy while steps are taken for it, except those
that relax it: they overtake the others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, TypeVar

from head_tracking.dynamixel.configuration import BusSettings, EepromSettings
from head_tracking.dynamixel.events import Events
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    DynamixelError,
    NotConnectedError,
    PortLostError,
    ServoError,
    TorqueError,
)
from head_tracking.dynamixel.joint import Joint
from head_tracking.dynamixel.maintenance import write_eeprom
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.relaxing import relaxing
from head_tracking.dynamixel.requests import RequestQueue, Steps
from head_tracking.dynamixel.servo import Servo
from head_tracking.dynamixel.state import EventKind

_T = TypeVar("_T")
_CONVINCED: Final = 3  # times that a servo must seem unusable
_BRAKING: Final = 0.6  # s that a joint may take to stop
_STANDS: Final = 0.1  # rad/s
_GONE: Final = (PortLostError, NotConnectedError)


class Procedures:
    """Carries out what takes several transactions.

    Args:
        port: Where the servos are.
        joints: All joints of the bus.
        requests: Takes steps for later cycles.
        events: Takes what happens.
        settings: How to deal with silence.
        monotonic: Time that never jumps, ns.
        pause: Waits so many seconds.

    Attributes:
        obeyed: The last epoch whose STOP has been carried out.
    """

    def __init__(
        self,
        port: DynamixelPort,
        joints: Sequence[Joint],
        requests: RequestQueue,
        events: Events,
        settings: BusSettings,
        monotonic: Callable[[], int],
        pause: Callable[[float], object],
    ) -> None:
        self.obeyed = requests.epoch.value
        self._port, self._joints, self._requests = port, joints, requests
        self._note = events.note
        self._watchdog = bool(settings.watchdog)
        self._poll_interval = round(settings.poll_interval * 1e9)
        self._monotonic, self._pause = monotonic, pause
        self._unusable: dict[int, tuple[str, int]] = {}  # why, and how often, by servo id

    def begin(self, steps: Steps[Any], joint: Joint | None = None) -> None:
        """Take steps between the work of the next cycles, unless STOP comes before.

        Args:
            steps: The steps.
            joint: That is busy from now on until they end.
        """
        if joint is None:
            self._requests.start(steps)
        else:
            self._requests.advance(self._requests.start(self.exclusively(joint, steps)))

    def exclusively(self, joint: Joint, steps: Steps[_T]) -> Steps[_T]:
        """Take steps while nobody else takes any for this joint."""
        while joint.busy:
            yield 0.002
        joint.busy = True
        try:
            yield 0.0
            return (yield from steps)
        finally:
            joint.busy = False

    def braking(self) -> Steps[None]:
        """Wait until the joints that hold where they are stand."""
        moving = [servo for joint in self._joints if joint.on for servo in joint.servos]
        deadline = self._monotonic() + round(_BRAKING * 1e9)
        for _ in range(round(_BRAKING / 0.002)):  # should the clock stand still
            moving = [servo for servo in moving if not (servo.lost or self._stands(servo))]
            if not moving or self._monotonic() > deadline:
                return
            yield 0.002

    def _stands(self, servo: Servo) -> bool:
        try:
            servo.read_feedback()
        except CommunicationError:
            return False
        return abs(servo.velocity) <= _STANDS

    # Torque off

    def relax(
        self, joints: Sequence[Joint], *, stop: bool = False, disarm: bool = False
    ) -> Steps[dict[str, str]]:
        """Relax joints: the first step switches torque off, the others make sure.

        Args:
            joints: The joints.
            stop: Whether to take them out of the cycle, too.
            disarm: Whether to switch off the Bus Watchdog of their servos, too.

        Returns:
            By joint, why it has not confirmed; empty where it has.
        """
        # What was relaxed when it was stopped need not be there any more.
        sure = [joint for joint in joints if joint.stopped and joint.confirmed]
        for joint in joints:
            self._requests.drop_goals(joint.name)
            joint.relax()
            if stop:
                joint.set_stopped(True)
        servos = [servo for joint in joints for servo in joint.servos]
        found = yield from relaxing(self._port, servos, disarm=disarm)
        for joint in sure:
            for servo in joint.servos:
                found[servo.id], servo.confirmed = "", True
        return {
            joint.name: "; ".join(filter(None, [found[servo.id] for servo in joint.servos]))
            for joint in joints
        }

    def relaxing(
        self, joints: Sequence[Joint], *, stop: bool = False, on_request: bool = False
    ) -> Steps[None]:
        """Relax joints and report it; see `ServoBus.switching_torque` and `ServoBus.stopping`."""
        for joint in joints:
            joint.relaxed |= on_request
        found = yield from self.relax(joints, stop=stop, disarm=stop)
        for joint in joints:
            if not found[joint.name]:
                kind = EventKind.STOPPED if stop else EventKind.TORQUE_OFF
                self._note(kind, joint, joint.torque.value)
        problems = {name: problem for name, problem in found.items() if problem}
        if problems:
            raise TorqueError(False, problems)

    def cut(self, joint: Joint) -> None:
        """Relax a joint at once, and make sure of it in the next cycles."""
        self._requests.advance(self._requests.start(self._cutting(joint), despite_stop=True))

    def _cutting(self, joint: Joint) -> Steps[None]:
        problem = (yield from self.relax([joint]))[joint.name]
        if problem:
            self._note(EventKind.TORQUE_FAILED, joint, f"not confirmed relaxed: {problem}")

    def stop(self, timeout: float, epoch: int) -> Mapping[str, str]:
        """Relax all joints, whatever else is under way; see `ServoBus.relax_at_once`."""
        deadline = self._monotonic() + round(timeout * 1e9)
        self.obeyed = epoch
        self._requests.discard_older()
        steps = self.relax(self._joints)
        try:
            while self._monotonic() <= deadline:
                self._pause(next(steps))
        except StopIteration as end:
            problems: dict[str, str] = end.value
            return problems
        steps.close()
        late = "it has not confirmed in time"
        return {joint.name: "" if joint.confirmed else late for joint in self._joints}

    def obey_stop(self) -> None:
        """Carry out a STOP that could not wait until the owner's thread had left the port."""
        self.obeyed = self._requests.epoch.value
        self._requests.discard_older()
        self._requests.start(self.relaxing(self._joints), despite_stop=True)

    # Torque on

    def switching_on(self, joints: Sequence[Joint]) -> Steps[None]:
        """Hold joints where they stand; see `ServoBus.switching_torque`."""
        problems: dict[str, object] = {}
        for joint in joints:  # all in the first step: who relaxes one later is heard
            if not (joint.stopped or joint.faulted or joint.resting):
                joint.relaxed = False
        for joint in joints:
            try:
                problem = yield from self.exclusively(joint, joint.switch_on())
            except _GONE as cause:
                problem = str(cause)
            if problem:
                problems[joint.name] = problem
            else:
                self._note(EventKind.TORQUE_ON, joint, joint.torque.value)
        if problems:
            raise TorqueError(True, problems)

    def switch_on_for_goal(self, joint: Joint) -> None:
        """Switch the torque of a joint on, because there is a goal for it; or drop the goal."""
        self.begin(self._switching_on_for_goal(joint), joint)

    def _switching_on_for_goal(self, joint: Joint) -> Steps[None]:
        problem = yield from joint.switch_on()
        if problem:
            self._requests.drop_goals(joint.name)
            self._note(EventKind.TORQUE_FAILED, joint, f"goal dropped: {problem}")
        else:
            self._note(EventKind.TORQUE_ON, joint, joint.torque.value)

    def clear_watchdog(self, joint: Joint, why: str = "its Bus Watchdog tripped") -> None:
        """Hold a joint where it is, with the watchdogs of its servos armed anew."""
        if not joint.busy:
            self.begin(self._holding(joint, why), joint)

    def _holding(self, joint: Joint, why: str) -> Steps[None]:
        problem = yield from joint.pin(powered=True)
        self._note(EventKind.HELD, joint, f"{why}; {problem or 'it holds where it is'}")

    # Faults, joints that are taken out and back, memory

    def recovering(self, joints: Sequence[Joint], patience: float) -> Steps[tuple[str, ...]]:
        """Clear the faults of joints; see `ServoBus.recovering`."""
        faulted = [joint for joint in joints if joint.faulted]
        problems: dict[str, object] = {}
        for joint in faulted:
            self._requests.drop_goals(joint.name)
            try:
                problem = yield from self.exclusively(joint, joint.recover(self._monotonic()))
            except _GONE as cause:
                problem = str(cause)
            if problem:
                problems[joint.name] = problem
            else:
                result = "it restarts" if joint.lost else joint.torque.value
                self._note(EventKind.RECOVERED, joint, result)
        _raise(problems)
        deadline = self._monotonic() + round(patience * 1e9)
        while patience and (waiting := [joint.name for joint in faulted if joint.faulted]):
            if self._monotonic() > deadline:
                raise ServoError(f"{', '.join(waiting)}: does not recover; see /diagnostics")
            yield 0.02
        return tuple([joint.name for joint in faulted])

    def starting(self, joints: Sequence[Joint]) -> Steps[None]:
        """Take stopped joints back; see `ServoBus.starting`."""
        problems: dict[str, object] = {}
        for joint in joints:
            if not joint.stopped:
                continue
            try:
                yield from self.exclusively(joint, joint.identify())
            except DynamixelError as cause:
                for servo in joint.servos:
                    servo.lose(0)
                problems[joint.name] = cause
            else:
                self._note(EventKind.STARTED, joint, joint.torque.value)
                for servo in joint.servos:
                    self.note_shortcomings(joint, servo)
            joint.set_stopped(False)
        _raise(problems)

    def writing_eeprom(
        self, joint: Joint, settings: EepromSettings
    ) -> Steps[dict[int, dict[str, tuple[int, int]]]]:
        """Write settings into the memory of servos; see `ServoBus.writing_eeprom`."""
        wanted = {
            servo.id: settings.registers(servo.model, servo.calibration.tick_range)
            for servo in joint.servos
        }
        changed = {}
        self._requests.drop_goals(joint.name)
        joint.writing = True
        try:
            for servo in joint.servos:
                changed[servo.id] = yield from write_eeprom(servo, wanted[servo.id])
            for servo in joint.servos:
                if not joint.stopped and not servo.lost:
                    yield from servo.identify()
        finally:
            joint.writing = False
        return changed

    # A servo that answers again

    def return_servo(self, joint: Joint, servo: Servo) -> None:
        """Take a servo that answers again back, in the next cycles."""
        self.begin(self._returning(joint, servo), joint)

    def _returning(self, joint: Joint, servo: Servo) -> Steps[None]:
        try:
            torque = yield from joint.come_back(servo)
        except (CommunicationError, ServoError, ConfigurationError) as cause:
            servo.lose(self._monotonic() + self._poll_interval)
            if not isinstance(cause, CommunicationError):
                text, times = self._unusable.get(servo.id, ("", 0))
                times = times + 1 if text == str(cause) else 1
                self._unusable[servo.id] = (str(cause), times)
                if times == _CONVINCED:
                    self._note(EventKind.UNUSABLE, joint, str(cause))
            return
        self._unusable.pop(servo.id, None)
        self._note(EventKind.RETURNED, joint, f"answers again; {torque}")
        self.note_shortcomings(joint, servo)

    def note_shortcomings(self, joint: Joint, servo: Servo) -> None:
        """Note what a servo that was found lacks."""
        identity, first = servo.identity, servo.model.watchdog
        if identity is None or servo.lost:
            return
        if identity.faulted:
            self._note(
                EventKind.FAULTED,
                joint,
                f"servo {servo.id} has shut itself down before; it takes no commands until "
                "somebody calls recover",
            )
        if first is not None and self._watchdog and not servo.watched:
            self._note(
                EventKind.ALARM,
                joint,
                f"servo {servo.id} has firmware {identity.firmware_version}, which has no Bus "
                f"Watchdog ({first} has): should this program die, it goes on to its goal",
                about="firmware",
            )


def _raise(problems: Mapping[str, object]) -> None:
    if problems:
        raise ServoError("; ".join(f"{joint}: {problem}" for joint, problem in problems.items()))
