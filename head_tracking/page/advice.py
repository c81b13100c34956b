"""What is wrong with the robot, in one sentence each, and what a person can do about it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from head_tracking.recording.recording import Observation
from head_tracking.ros.kit.diagnostics import Health, Level

_CLEAR = "press Clear faults and switch torque on again (place Joints)."
_ADVICE = (
    ("nothing heard", "Is {source} still running? Look at its terminal.", ""),
    ("port has gone", "Check the adapter's plug and its USB cable; it comes back by itself.", ""),
    ("overheating", f"Press STOP, let the servo cool down, then {_CLEAR}", "recover"),
    ("degrees celsius", "Press STOP and let the servo cool down. Is it blocked?", ""),
    ("overload", f"Press STOP, free the head, then {_CLEAR}", "recover"),
    ("voltage", f"Check the supply's voltage under load, and the plug. Then {_CLEAR}", "recover"),
    ("shock", f"Check the supply and the wiring of the servo, then {_CLEAR}", "recover"),
    ("encoder", "Switch the servo's power off and on; if it says so again, it is broken.", ""),
    ("not found yet", "Check the servo's plug, power, id and baud rate (see `servo scan`).", ""),
    ("does not answer", "Check the servo's plug, power and id; it comes back by itself.", ""),
)
"""By the words in which the servo bus names them; the first that fit: what to do, and the command
of the page that may end it."""

_OTHERWISE = "Press STOP if the head does what it should not; the place Health has the details."


class Trouble(NamedTuple):
    """Something wrong.

    Attributes:
        what: what it is.
        advice: what to do.
        mend: the page's command that may end it; empty: there is none.
    """

    what: str
    advice: str
    mend: str = ""


def troubles(health: Sequence[Health], live: Observation) -> list[Trouble]:
    """What belongs on the red banner; empty while all is well.

    Args:
        health: the newest diagnostics.
        live: the robot now.
    """
    found = [
        Trouble(
            f"{node} has gone: nothing turns the head or gives it targets as the mode says",
            f"Start {node} again, or choose another mode (place Live).",
        )
        for node in live.missing_nodes
    ]
    if live.silent_joints:
        found.append(
            Trouble(
                f"no joint states of {', '.join(live.silent_joints)}: the head is left alone, and "
                "the page shows where it was",
                "Is whoever measures the joints running (servo_bus, joint_state_publisher)? Is the "
                "servos' power on?",
            )
        )
    for one in health:
        source = one.name.partition(":")[0]
        if one.level >= Level.ERROR and source not in live.missing_nodes and not _passing(one):
            what = f"{one.name.removeprefix('servo_bus: ')}: {one.message}"
            found.append(Trouble(what, *advice(one.message, source)))
    return found


def _passing(one: Health) -> bool:
    """Whether a servo has just missed a cycle; if it goes on, the bus says that it is lost."""
    return one.level is Level.STALE and "no answer since" in one.message


def advice(message: str, source: str) -> tuple[str, str]:
    """Return what to do about a message of diagnostics, and the page's command that may help.

    Args:
        message: its words.
        source: the node that it belongs to.
    """
    lower = message.lower()
    text, mend = next(
        ((text, mend) for words, text, mend in _ADVICE if words in lower), (_OTHERWISE, "")
    )
    return text.format(source=source), mend
