"""Protect servos: shutdown, heat, lost torque, missing commands.

Called only for joints with something unusual.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Final

from head_tracking.dynamixel.context import BusContext
from head_tracking.dynamixel.exceptions import CommunicationError
from head_tracking.dynamixel.joint import Joint
from head_tracking.dynamixel.procedures import Procedures
from head_tracking.dynamixel.protocol import ErrorBits, describe_errors
from head_tracking.dynamixel.servo import LinkState, Servo
from head_tracking.dynamixel.state import EventKind, ServoState

_REPEAT: Final = 1_000_000_000  # ns between two reads of the error register of a servo
_ARRIVED: Final = 5.0  # ticks
_ABOUT_PACKET: Final = ErrorBits.ANGLE_LIMIT | ErrorBits.RANGE | ErrorBits.INSTRUCTION
"""Error bits of protocol 1.0 about a packet, not about the servo."""


class Protection:
    """Relaxes or holds joints for their protection.

    Args:
        bus: What the parts of the bus share.
        procedures: Relaxes joints.
    """

    def __init__(self, bus: BusContext, procedures: Procedures) -> None:
        self._note, self._cut, self._settings = bus.note, procedures.cut, bus.settings
        self._command_timeout = round(bus.settings.command_timeout * 1e9)
        self._read_at: dict[int, int] = {}  # ns, by servo id
        self._reported: dict[int, object] = {}  # errors, by servo id

    def judge(self, joint: Joint, state: ServoState, now: int) -> None:
        """Judge a joint by its measurements; `now` is monotonic, ns.

        Raises:
            PortLostError: The port was lost.
        """
        for servo in joint.servos:
            if not servo.answers:
                continue
            if servo.error or servo.errors or servo.id in self._reported:
                self._judge_errors(joint, servo, now)
            if servo.link is LinkState.INTERRUPTED and not joint.busy:
                self._check_torque(joint, servo)
        self._judge_heat(joint, state.temperature)
        if self._command_timeout and joint.on:
            self._judge_command(joint, state, now)

    def _judge_errors(self, joint: Joint, servo: Servo, now: int) -> None:
        if servo.model.protocol == 2:
            new = bool(servo.error) != bool(servo.errors)
            if new or now - self._read_at.get(servo.id, 0) >= _REPEAT:
                self._read_at[servo.id] = now
                with suppress(CommunicationError):
                    servo.errors = servo.read_errors()
        errors = servo.errors
        if isinstance(errors, ErrorBits):
            errors &= ~_ABOUT_PACKET
        if servo.identity is not None and errors & servo.identity.shutdown:
            if not servo.faulted:
                servo.faulted = True
                self._cut(joint)
                self._note(
                    EventKind.FAULTED,
                    joint,
                    f"servo {servo.id} has shut itself down: {describe_errors(errors)}; it takes "
                    "no commands until recover is called",
                )
        elif errors and self._reported.get(servo.id) != errors:
            text = f"servo {servo.id} reports: {describe_errors(errors)}"
            self._note(EventKind.ALARM, joint, text, about=errors)
        if errors:
            self._reported[servo.id] = errors
        else:
            self._reported.pop(servo.id, None)

    def _check_torque(self, joint: Joint, servo: Servo) -> None:
        """Find a servo that was without power for a moment; it must not move to the old goal."""
        if joint.on:
            try:
                powered = servo.get("Torque Enable", 1) == 1
            except CommunicationError:
                return  # the next cycle asks again
            if not powered:
                self._cut(joint)
                self._note(
                    EventKind.TORQUE_LOST,
                    joint,
                    f"servo {servo.id} has lost its torque, probably with its power; the joint is "
                    "relaxed until the next command",
                )
        servo.note_torque()

    def _judge_heat(self, joint: Joint, temperature: float) -> None:
        settings = self._settings
        if temperature >= settings.rest:
            if joint.on:
                joint.resting = True
                self._cut(joint)
                self._note(
                    EventKind.RESTING,
                    joint,
                    f"{temperature:.0f} °C is too hot; it is relaxed until {settings.warm:.0f} °C",
                )
        elif joint.resting and temperature < settings.warm:
            joint.resting = False
            self._note(EventKind.COOLED, joint, f"{temperature:.0f} °C; it takes commands again")

    def _judge_command(self, joint: Joint, state: ServoState, now: int) -> None:
        """Hold a moving joint when no command has come for some time."""
        since = joint.commanded_at
        if since is None or now - since < self._command_timeout:
            return
        if abs(state.position_error or 0.0) <= _ARRIVED * joint.configuration.resolution:
            joint.commanded_at = None
            return
        joint.hold()
        self._note(
            EventKind.HELD,
            joint,
            f"no command for {self._settings.command_timeout:.2f} s; it holds its position",
        )
