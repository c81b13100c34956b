"""Looks after the servos: faults, heat, torque that has gone, motions nobody asks for any more."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Final

from head_tracking.dynamixel.bus_joint import BusJoint
from head_tracking.dynamixel.bus_servo import BusServo
from head_tracking.dynamixel.command import Torque
from head_tracking.dynamixel.exceptions import CommunicationError
from head_tracking.dynamixel.journal import Journal
from head_tracking.dynamixel.protocol import ErrorBits, describe_errors
from head_tracking.dynamixel.servo_state import EventKind, ServoState
from head_tracking.dynamixel.settings import BusSettings

_REPEAT: Final = 1_000_000_000  # ns between two looks at the error register of a servo
_ARRIVED: Final = 5.0  # ticks
_PASSING: Final = ErrorBits.ANGLE_LIMIT | ErrorBits.RANGE | ErrorBits.INSTRUCTION
"""What a protocol 1.0 servo says about a packet, not about itself."""


class Protection:
    """Judges what each cycle has read, and relaxes what must not go on.

    Args:
        joints: All joints of the bus.
        journal: Gets the events.
        monotonic: Time that never jumps, ns.
        settings: Temperatures and times.
    """

    def __init__(
        self,
        joints: Sequence[BusJoint],
        journal: Journal,
        monotonic: Callable[[], int],
        settings: BusSettings,
    ) -> None:
        self._joints = joints
        self._journal = journal
        self._monotonic = monotonic
        self._settings = settings
        self._command_timeout = round(settings.command_timeout * 1e9)
        self._watchdog = round(settings.watchdog * 1e9)
        self._looked_at: dict[int, int] = {}
        self._told: dict[int, object] = {}
        self._last_cycle: int | None = None
        self._watched = any(joint.watched for joint in joints)

    def before_cycle(self) -> None:
        """Hold the joints whose servos may have stopped by themselves since the last cycle.

        A tripped watchdog answers reads and ignores goals, so that only the time tells.

        Raises:
            PortLostError: The port has gone.
        """
        if not self._watched:
            return
        now, last = self._monotonic(), self._last_cycle
        self._last_cycle = now
        if last is None or self._watchdog == 0 or now - last < self._watchdog:
            return
        for joint in self._joints:
            if joint.drives and joint.watched:
                problem = joint.pin()
                text = f"the bus stood still for {(now - last) * 1e-9:.1f} s"
                self._note(EventKind.HELD, joint, f"{text}; {problem or 'it holds where it is'}")

    def after_cycle(self, states: Mapping[str, ServoState]) -> None:
        """Judge what was read.

        Args:
            states: What was read in this cycle, by joint.

        Raises:
            PortLostError: The port has gone.
        """
        for joint in self._joints:
            if joint.name in states:
                for servo in joint.servos:
                    feedback = servo.feedback
                    if feedback is None or servo.failed_cycles:
                        continue
                    if feedback.error or servo.errors or servo.id in self._told:
                        self._judge_errors(joint, servo)
                    if servo.interrupted:
                        self._look_for_torque(joint, servo)
                if joint.torque is Torque.OFF_TO_COOL or (
                    states[joint.name].temperature >= self._settings.rest
                ):
                    self._judge_heat(joint, states[joint.name].temperature)
                if self._command_timeout:
                    self._judge_command(joint, states[joint.name])

    def _judge_errors(self, joint: BusJoint, servo: BusServo) -> None:
        assert servo.feedback is not None and servo.identity is not None
        if servo.mount.model.protocol == 2:
            now = self._monotonic()
            new = bool(servo.feedback.error) != bool(servo.errors)
            if new or now - self._looked_at.get(servo.id, 0) >= _REPEAT:
                self._looked_at[servo.id] = now
                with suppress(CommunicationError):
                    servo.errors = servo.link.errors(servo.feedback.error)
        errors = servo.errors
        if isinstance(errors, ErrorBits):
            errors &= ~_PASSING
        if errors & servo.identity.shutdown:
            if not servo.faulted:
                servo.faulted = True
                joint.switch_off(Torque.OFF_BY_FAULT)
                self._note(
                    EventKind.FAULTED,
                    joint,
                    f"servo {servo.id} has shut itself down: {describe_errors(errors)}; it takes "
                    "no commands until somebody calls recover",
                )
        elif errors and self._told.get(servo.id) != errors:
            self._note(EventKind.ALARM, joint, f"servo {servo.id} says: {describe_errors(errors)}")
        if errors:
            self._told[servo.id] = errors
        else:
            self._told.pop(servo.id, None)

    def _look_for_torque(self, joint: BusJoint, servo: BusServo) -> None:
        """Notice a servo that was without power for a moment, and would start where it left off."""
        if not joint.drives:
            servo.interrupted = False
            return
        try:
            powered = servo.link.get("Torque Enable") == 1
        except CommunicationError:
            return  # the next cycle asks again
        servo.interrupted = False
        if not powered:
            joint.switch_off(Torque.OFF_UNTIL_COMMANDED)
            self._note(
                EventKind.TORQUE_LOST,
                joint,
                f"servo {servo.id} has lost its torque, probably with its power; the joint is "
                "relaxed until the next command",
            )

    def _judge_heat(self, joint: BusJoint, temperature: float) -> None:
        settings = self._settings
        if temperature >= settings.rest:
            if joint.drives:
                joint.switch_off(Torque.OFF_TO_COOL)
                self._note(
                    EventKind.RESTING,
                    joint,
                    f"{temperature:.0f} °C is too hot; it is relaxed until {settings.warm:.0f} °C",
                )
        elif temperature < settings.warm:
            joint.torque = Torque.OFF_UNTIL_COMMANDED
            self._note(EventKind.COOLED, joint, f"{temperature:.0f} °C; it takes commands again")

    def _judge_command(self, joint: BusJoint, state: ServoState) -> None:
        since = joint.commanded_at
        if since is None or self._monotonic() - since < self._command_timeout:
            return
        if abs(state.position_error or 0.0) <= _ARRIVED * joint.configuration.resolution:
            joint.keep_goal()
            return
        joint.hold(self._settings.retries)
        self._note(
            EventKind.HELD,
            joint,
            f"no command for {self._settings.command_timeout:.2f} s; it holds where it is",
        )

    def _note(self, kind: EventKind, joint: BusJoint, text: str) -> None:
        self._journal.note(kind, joint.name, joint.servos[0].id, text)
