"""What is wrong with the robot, in one sentence each, and what a person can do about it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from head_tracking.viewer.robot import Health, Level, Observation

_ADVICE = (
    ("lost", "Check the servo's plug, its power and its id; it comes back by itself."),
    ("heat", "Press STOP and let the servo cool down before you switch its torque on again."),
    ("overload", "Press STOP, free the head, then clear the fault and switch torque on again."),
    ("voltage", "Check the power supply: its voltage under load, and the plug."),
    ("nothing heard", "Is the servo bus still running? Look at its terminal."),
    ("port", "Check the adapter's plug and that you may open its port."),
)
_OTHERWISE = "Press STOP if the head does what it should not; the tab Health has the details."


class Trouble(NamedTuple):
    """Something wrong.

    Attributes:
        what: what it is.
        advice: what to do.
    """

    what: str
    advice: str


def troubles(health: Sequence[Health], live: Observation) -> list[Trouble]:
    """What belongs on the red banner; empty while all is well.

    Args:
        health: the newest diagnostics.
        live: the robot now.
    """
    found = [
        Trouble(f"{one.name.removeprefix('servo_bus: ')}: {one.message}", advice(one.message))
        for one in health
        if one.level >= Level.ERROR
    ]
    return found


def advice(message: str) -> str:
    """What to do about what a part says of itself."""
    lower = message.lower()
    return next((text for word, text in _ADVICE if word in lower), _OTHERWISE)
