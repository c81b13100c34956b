"""Errors of the servo driver; `DynamixelError` is the root."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from head_tracking.exceptions import HeadTrackingError
from head_tracking.parameters import ParameterError

if TYPE_CHECKING:
    from head_tracking.dynamixel.port import DynamixelPort


def _join(values: Iterable[object]) -> str:
    return ", ".join(str(value) for value in values) or "none"


class DynamixelError(HeadTrackingError):
    """Root of all errors of servos and their bus."""


class ConfigurationError(DynamixelError, ParameterError):
    """The configuration of a joint, a model name or a baud rate is wrong."""


class RangeError(DynamixelError, ValueError):
    """A value does not fit its register or unit."""


class NotConnectedError(DynamixelError):
    """The bus was used before `connect()` or after `close()`."""


class BusStoppedError(DynamixelError):
    """The thread that owns the bus does not run."""


class StoppedError(DynamixelError):
    """STOP came after a request or a goal was made, so it was not carried out."""


class GoalError(DynamixelError):
    """A command was refused; nothing has changed."""


class PortError(DynamixelError):
    """The serial port `port_name` cannot be opened."""

    def __init__(self, port_name: str, reason: str) -> None:
        super().__init__(f"cannot open {port_name}: {reason}")
        self.port_name = port_name


class PortMissingError(PortError):
    """There is no such device; `existing`: serial devices of this machine, if they were listed."""

    def __init__(self, port_name: str, existing: Sequence[str] = ()) -> None:
        found = "is the adapter plugged in?"
        if existing:
            found = f"serial ports that exist: {_join(existing)}"
        simulated = "without servos: `head_tracking --sim`, or Head.simulated()"
        super().__init__(port_name, f"there is no such device; {found} ({simulated})")


class PortBusyError(PortError):
    """Another program, or another object of this one, uses the device."""

    def __init__(self, port_name: str) -> None:
        super().__init__(
            port_name,
            "another program uses it, or a Head of this program that is not closed; only one can "
            f"own a servo bus. Stop or close the other one (`fuser {port_name}` names its process)",
        )


class PortPermissionError(PortError):
    """The user may not open the device."""

    def __init__(self, port_name: str, group: str) -> None:
        cure = (
            "A udev rule has to give it to dialout: `head_tracking head_setup udev` has one for "
            "most adapters"
            if group == "root"
            else f"Join it with `sudo usermod -a -G {group} $USER`, then log out and in again"
        )
        super().__init__(
            port_name, f"you have no permission; the device belongs to group {group}. {cure}"
        )


class BaudRateError(PortError, ConfigurationError):
    """The device does not support the baud rate."""


class PortLostError(DynamixelError):
    """The open port `port_name` was lost: it was unplugged, or its other end has closed."""

    def __init__(self, port_name: str, reason: object) -> None:
        super().__init__(f"lost {port_name}: {reason}; check the cable of the adapter")
        self.port_name = port_name


class CommunicationError(DynamixelError):
    """One transaction failed; the next may succeed."""


class LineBusyError(CommunicationError):
    """Another program sends without a pause that is long enough for a packet."""

    def __init__(self, port_name: str, patience: float) -> None:
        super().__init__(
            f"another program sends on the line of {port_name} without a pause: nothing could be "
            f"sent for {patience * 1e3:.0f} ms. Only one program can own a servo bus: stop it"
        )


class ReplyTimeoutError(CommunicationError):
    """A servo did not answer in time."""


class CorruptReplyError(CommunicationError):
    """A reply was damaged, or did not fit the instruction."""


def advice(servo_id: int) -> str:
    """Return the probable causes of damaged replies."""
    return (
        f"two servos answer as id {servo_id} (connect one alone and give it another id with "
        "`head_tracking servo set-id`), or something disturbs the line"
    )


class ServoError(DynamixelError):
    """A servo is missing, is another one than configured, or refuses an instruction."""


class ServoNotFoundError(ServoError):
    """Configured servos do not answer a ping.

    Attributes:
        asked: All ids that were pinged.
        answered: Those that answered.
    """

    def __init__(self, asked: Sequence[int], answered: Sequence[int], port: DynamixelPort) -> None:
        missing = [servo for servo in asked if servo not in answered]
        super().__init__(
            f"no answer from servo id {_join(missing)} on {port.name} at {port.baud_rate} baud "
            f"(asked {_join(asked)}; answered: {_join(answered)}). Check that the servos have "
            "power, and that the cable runs on to every one of them; "
            f"`{port.servo_command('scan')}` finds other ids and baud rates"
        )
        self.asked = tuple(asked)
        self.answered = tuple(answered)


class TorqueError(ServoError):
    """Torque could not be switched, or not be confirmed, on the joints of `problems`."""

    def __init__(self, on: bool, problems: Mapping[str, object]) -> None:
        state = "on" if on else "off"
        details = "; ".join(f"{joint}: {problem}" for joint, problem in problems.items())
        super().__init__(f"torque {state} not confirmed: {details}")
        self.problems = dict(problems)
