"""The status of a head in one word, and its faults with advice."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from head_tracking.compatibility import StrEnum
from head_tracking.page.joint_control import JointServo
from head_tracking.recording.recording import Observation
from head_tracking.ros.kit.diagnostics import FAULT, FaultName, Level, Part
from head_tracking.tracking import TargetState

_ON_TARGET = math.radians(2.0)
_SEEN = 0.5  # s: a head is not on a target that was last seen longer ago


class Word(StrEnum):
    """What a head does."""

    DISCONNECTED = "disconnected"
    FAULT = "fault"
    STOPPED = "stopped"
    RELAXED = "relaxed"
    REFUSED = "refused"
    AT_LIMIT = "at the limit"
    MOVING = "moving"
    ON_TARGET = "on target"
    HOLDING = "holding"
    WAITING = "waiting"


class Summary(NamedTuple):
    """What a head does, and the reason."""

    word: Word
    reason: str


_WORDS: Mapping[str, Word] = {
    TargetState.IDLE: Word.HOLDING,
    TargetState.ACQUIRING: Word.MOVING,
    TargetState.TRACKING: Word.ON_TARGET,
    TargetState.AT_LIMIT: Word.AT_LIMIT,
    TargetState.COASTING: Word.MOVING,
    TargetState.RECENTERING: Word.MOVING,
    TargetState.SEARCHING: Word.MOVING,
    TargetState.STALLED: Word.FAULT,
    TargetState.DISABLED: Word.HOLDING,
}
"""By the controller's state. In any other one, the head's error decides."""
_WITHOUT_TARGET = (TargetState.IDLE, TargetState.HOLDING)
_FOLLOWING = (
    TargetState.TRACKING,
    TargetState.ACQUIRING,
    TargetState.COASTING,
    TargetState.AT_LIMIT,
)


def head_status(
    live: Observation,
    health: Sequence[Part],
    servos: Sequence[JointServo],
    silent: Sequence[str] = (),
    *,
    stopped: bool,
    sought: str = "",
    has_camera: bool = True,
) -> Summary:
    """Return what a head does: the worst condition that holds.

    `silent` joints of the head are expected and not measured. `sought` is what the head follows
    once the camera sees it; empty: it is seen, or the head has another target.
    """
    if silent or not live.joints:
        joints = ", ".join(silent) or "the robot"
        return Summary(Word.DISCONNECTED, f"no measurement of {joints} is received")
    if stopped:
        return Summary(Word.STOPPED, "nothing moves before Resume")
    for one in health:
        if one.level is Level.ERROR:
            return Summary(Word.FAULT, f"{one.name}: {one.message}")
    is_sought = bool(sought) and live.state in _WITHOUT_TARGET
    # else it concerns one point of many, or something that was seen before
    if live.refusal and live.state not in _FOLLOWING and not is_sought:
        return Summary(Word.REFUSED, live.refusal)
    relaxed = [servo for servo in servos if servo.torque is False]
    if relaxed and len(relaxed) == len(servos):
        if any(servo.refuses for servo in servos):
            return Summary(Word.RELAXED, "until torque is enabled on the tab Joints")
        return Summary(Word.RELAXED, "until the next command")
    if not live.controller:
        return Summary(Word.HOLDING, "no controller is enabled")
    if is_sought:
        advice = "press Centre, or aim and choose again"
        why = advice if has_camera else "no camera publishes images"
        return Summary(Word.WAITING, f"no {sought} in view: {why}")
    word = _WORDS.get(live.state)
    if word is None:  # point_head, or a tracker without a target
        if live.error is not None and live.error < _ON_TARGET:
            return Summary(Word.ON_TARGET, "")
        is_moving = live.error is not None or live.state == "turning"
        return Summary(Word.MOVING if is_moving else Word.HOLDING, live.detail)
    if word is not Word.ON_TARGET:
        return Summary(word, live.detail)
    if live.target_stamp is None or live.stamp - live.target_stamp > _SEEN * 1e9:
        return Summary(Word.MOVING, "the target is not seen; the head follows its prediction")
    if live.error is None or live.error > _ON_TARGET:
        return Summary(Word.MOVING, "the head turns to the target")
    return Summary(Word.ON_TARGET, "")


_CLEAR = "press Clear faults: the head goes on to its target."
_ADVICE: dict[str, tuple[str, str]] = {
    FaultName.SILENT: ("Is {node} still running? Look at its terminal.", ""),
    FaultName.NO_PORT: ("Check the adapter's plug and USB cable. The bus reconnects itself.", ""),
    FaultName.NOT_FOUND: (
        "Check plug, power, id and baud rate of the servo (`head_tracking servo scan`).",
        "",
    ),
    FaultName.NO_ANSWER: ("Check the servo's plug, power and id. The bus reconnects itself.", ""),
    FaultName.HOT: ("Press STOP and let the servo cool down. Is it blocked?", ""),
    "overheating": (f"Press STOP, let the servo cool down, press Resume, then {_CLEAR}", "recover"),
    "overload": (f"Press STOP, free the head, press Resume, then {_CLEAR}", "recover"),
    "input voltage": (f"Check the supply under load, and the plug. Then {_CLEAR}", "recover"),
    "electrical shock": (f"Check the supply and the wiring of the servo, then {_CLEAR}", "recover"),
    "encoder": ("Switch the servo's power off and on. If the fault returns, replace it.", ""),
}
"""By name of the fault: the advice, and the command that may help."""

_NO_ADVICE = "Press STOP if the head moves unexpectedly. The tab Health has the details."


class ShownFault(NamedTuple):
    """A fault of the robot, and the page's command that may end it; empty: there is none."""

    text: str
    advice: str
    command: str = ""


def faults(
    health: Sequence[Part], missing: Sequence[str] = (), silent: Sequence[str] = ()
) -> list[ShownFault]:
    """Return the faults of a robot: `missing` nodes were enabled and have gone."""
    found = [
        ShownFault(
            f"{node} has gone, although it was enabled",
            f"Start {node} again, or choose another mode (tab Live).",
        )
        for node in missing
    ]
    if silent:
        found.append(
            ShownFault(
                f"no joint states of {', '.join(silent)}; the last ones are shown",
                "Does their publisher run (servo_bus, joint_state_publisher)? Have the servos "
                "power?",
            )
        )
    for one in health:
        name, node = one.values.get(FAULT, ""), one.name.partition(":")[0]
        # the bus calls a servo that misses more than one cycle lost
        if one.level >= Level.ERROR and node not in missing and name != FaultName.LATE:
            found.append(ShownFault(f"{one.name}: {one.message}", *advice(name, node)))
    return found


def advice(names: str, node: str) -> tuple[str, str]:
    """Return what to do about the faults of a node, and the command that may help."""
    known = (_ADVICE[name] for name in names.split(", ") if name in _ADVICE)
    text, command = next(known, (_NO_ADVICE, ""))
    return text.format(node=node), command
