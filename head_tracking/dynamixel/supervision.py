"""Who is there: reads servos, notices when one goes and when it comes back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from head_tracking.dynamixel.bus_joint import BusJoint
from head_tracking.dynamixel.bus_servo import BusServo
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    ServoError,
)
from head_tracking.dynamixel.journal import Journal
from head_tracking.dynamixel.port import ReadMethod, Reply, ServoPort
from head_tracking.dynamixel.protocol import NO_ERROR, ErrorBits
from head_tracking.dynamixel.reading_plan import ReadingPlan
from head_tracking.dynamixel.servo_state import EventKind, ServoState
from head_tracking.dynamixel.settings import BusSettings

_SHARE: Final = 10
"""Silence may take a tenth of the bus's time: a servo that cost 2 ms rests for 18 ms."""

_CONVINCED: Final = 3  # times that a servo must seem unusable
_SAMPLING: Final = 500_000
"""ns after the question; what takes longer happens after the servo has looked at its encoder."""

_LONGEST_WAIT: Final = 100_000_000  # ns that are believed; a clock may jump


class Supervision:
    """Keeps silent servos from slowing the others, and says once what happened to whom.

    Args:
        port: Where the servos are.
        joints: All joints of the bus.
        journal: Gets the events.
        clock: Time for the stamps of measurements, ns.
        monotonic: Time that never jumps, ns; decides when a lost servo is asked again.
        settings: How patient to be.
    """

    def __init__(
        self,
        port: ServoPort,
        joints: Sequence[BusJoint],
        journal: Journal,
        clock: Callable[[], int],
        monotonic: Callable[[], int],
        settings: BusSettings,
    ) -> None:
        self._port = port
        self._joints = joints
        self._journal = journal
        self._clock = clock
        self._monotonic = monotonic
        self._retries = settings.retries
        self._lost_after = settings.lost_after
        self._poll_interval = round(settings.poll_interval * 1e9)
        self._plan = ReadingPlan()
        self._problems: dict[int, tuple[str, int]] = {}

    def read(self, meanwhile: Callable[[], None]) -> tuple[dict[str, ServoState], tuple[str, ...]]:
        """Read the servos of all joints.

        Args:
            meanwhile: Called when the first question is on its way, or when there is none.

        Returns:
            What was read, by joint, and the joints that were asked in vain.

        Raises:
            PortLostError: The port has gone.
        """
        asked: list[tuple[BusJoint, list[BusServo]]] = []
        for joint in self._joints:
            if not joint.stopped:
                due = [servo for servo in joint.servos if self._due(servo)]
                if due:
                    asked.append((joint, due))
        for group, servos in self._plan.groups([servo for _, due in asked for servo in due]):
            replies = self._port.read_group(group)
            each = group.method is ReadMethod.EACH
            before = 0 if each else self._clock()
            meanwhile()
            meanwhile = _nothing
            for servo in servos:
                if each:
                    before = self._clock()
                self._take(servo, next(replies), before)
        meanwhile()
        states: dict[str, ServoState] = {}
        failed: list[str] = []
        for joint, due in asked:
            answered = [servo for servo in due if not servo.failed_cycles]
            if answered:
                states[joint.name] = joint.state(answered)
            else:
                failed.append(joint.name)
            if len(answered) < len(due):
                for servo in due:
                    if servo.failed_cycles >= self._lost_after:
                        self._lose(joint, servo)
        return states, tuple(failed)

    def poll_one_lost(self) -> None:
        """Ask one lost servo whose time has come.

        One per cycle, because each silent servo costs the others a timeout.

        Raises:
            PortLostError: The port has gone.
        """
        for joint in self._joints:
            for servo in joint.servos:
                if servo.lost and not joint.stopped and servo.ask_at <= self._monotonic():
                    servo.ask_at = self._monotonic() + self._poll_interval
                    self._poll(joint, servo)
                    return

    def lose_all(self) -> None:
        """Ask every servo anew, one per cycle: the port has gone and may come back."""
        for joint in self._joints:
            if not joint.stopped:
                for servo in joint.servos:
                    servo.lose(0)
                joint.lose()

    def _due(self, servo: BusServo) -> bool:
        if servo.lost:
            return False
        return not servo.failed_cycles or servo.ask_at <= self._monotonic()

    def _take(self, servo: BusServo, reply: Reply | CommunicationError, before: int) -> None:
        """Take note of an answer; ask again if it is none."""
        link = servo.link
        retries = 0 if servo.failed_cycles else self._retries
        while True:
            try:
                if isinstance(reply, CommunicationError):
                    raise reply
                feedback = link.feedback(reply)
            except CommunicationError as failure:
                link.count(failure)
                if retries <= 0:
                    break
            else:
                link.counters.replies += 1
                if servo.mount.model.protocol == 1:
                    servo.errors = ErrorBits(feedback.error & 0x7F) if feedback.error else NO_ERROR
                servo.answered(feedback, before + min((self._clock() - before) // 2, _SAMPLING))
                return
            retries -= 1
            link.counters.retries += 1
            before = self._clock()
            reply = self._again(servo)
        if servo.failed_cycles:
            cost = min(max(0, self._clock() - before), _LONGEST_WAIT)
            servo.failed(self._monotonic() + cost * (_SHARE - 1))
        else:
            servo.failed(0)

    def _again(self, servo: BusServo) -> Reply | CommunicationError:
        model = servo.mount.model
        block = model.feedback
        try:
            return self._port.read(servo.id, block.address, block.length, model.protocol)
        except CommunicationError as cause:
            return cause

    def _lose(self, joint: BusJoint, servo: BusServo) -> None:
        servo.lose(self._monotonic() + self._poll_interval)
        self._journal.note(
            EventKind.LOST,
            joint.name,
            servo.id,
            f"no answer in {servo.failed_cycles} cycles in a row; check its cable and power",
        )
        if joint.lost:
            joint.lose()

    def _poll(self, joint: BusJoint, servo: BusServo) -> None:
        try:
            servo.link.ping()
            torque = joint.come_back(servo)
        except CommunicationError:
            return
        except (ServoError, ConfigurationError) as cause:
            text, times = self._problems.get(servo.id, ("", 0))
            times = times + 1 if text == str(cause) else 1
            self._problems[servo.id] = (str(cause), times)
            if times == _CONVINCED:
                self._journal.note(EventKind.UNUSABLE, joint.name, servo.id, str(cause))
            return
        self._problems.pop(servo.id, None)
        self._journal.note(EventKind.RETURNED, joint.name, servo.id, f"answers again; {torque}")


def _nothing() -> None:
    pass
