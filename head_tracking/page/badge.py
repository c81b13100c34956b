"""One badge that tells the truth about the head."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from head_tracking.compatibility import StrEnum
from head_tracking.page.joint_control import Servo
from head_tracking.recording.recording import Observation
from head_tracking.ros.kit.diagnostics import Health, Level
from head_tracking.tracking import TargetState

_ON_TARGET = math.radians(2.0)
_SEEN = 0.5  # s: nobody knows whether a head is on a target that was last seen longer ago
_REFUSED = "refused: "


class Word(StrEnum):
    """What a head does."""

    DISCONNECTED = "disconnected"
    FAULT = "fault"
    STOPPED = "stopped"
    RELAXED = "relaxed"
    REFUSED = "refused"
    MOVING = "moving"
    ON_TARGET = "on target"
    HOLDING = "holding"
    REPLAY = "replay"


class Badge(NamedTuple):
    """A word, and why it is so."""

    word: Word
    text: str


_WORDS = {
    TargetState.IDLE: Word.HOLDING,
    TargetState.ACQUIRING: Word.MOVING,
    TargetState.TRACKING: Word.ON_TARGET,
    TargetState.AT_LIMIT: Word.REFUSED,
    TargetState.COASTING: Word.MOVING,
    TargetState.HOLDING: Word.HOLDING,
    TargetState.RECENTERING: Word.MOVING,
    TargetState.SEARCHING: Word.MOVING,
    TargetState.STALLED: Word.FAULT,
    TargetState.DISABLED: Word.HOLDING,
}
_FOLLOWING = (TargetState.TRACKING, TargetState.ACQUIRING, TargetState.COASTING)


def badge(
    live: Observation,
    health: Sequence[Health],
    servos: Sequence[Servo],
    *,
    stopped: bool,
    on: bool,
    complaint: str = "",
) -> Badge:
    """What a head does: the worst that is true, said by the node that turns it.

    Args:
        live: the robot now.
        health: the newest diagnostics.
        servos: what is known of their torque.
        stopped: the servo bus says that nothing moves before `resume`.
        on: a node is switched on to turn the head.
        complaint: what that node has complained of lately.
    """
    if not live.joints or live.silent_joints:
        silent = ", ".join(live.silent_joints)
        return Badge(
            Word.DISCONNECTED, f"nothing is heard of {silent or 'the robot'}: it may do anything"
        )
    wrong = next((one for one in health if one.level is Level.ERROR), None)
    if stopped:
        return Badge(Word.STOPPED, "nothing moves before Resume")
    if wrong is not None:
        return Badge(Word.FAULT, f"{wrong.name.removeprefix('servo_bus: ')}: {wrong.message}")
    said = live.state.partition(": ")[2]
    word, _, reason = said.partition(": ")
    refusal = complaint if "refused" in complaint else reason.partition(_REFUSED)[2]
    if refusal and word not in _FOLLOWING:  # then it was one point among many
        return Badge(Word.REFUSED, refusal)
    loose = [servo.joint or servo.controller for servo in servos if servo.torque is False]
    if loose and len(loose) == len(servos):
        refuses = any(servo.refuses for servo in servos)
        return Badge(
            Word.RELAXED,
            "torque is off until switched on (place Joints)" if refuses else "until a command",
        )
    if not on:
        return Badge(Word.HOLDING, "nothing turns the head")
    if complaint:
        return Badge(Word.HOLDING, complaint)
    try:
        found = _WORDS[TargetState(word)]
    except ValueError:  # a node that publishes no state
        if live.error is None:
            return Badge(Word.HOLDING, said or "no target has come yet")
        on_target = live.error < _ON_TARGET
        return Badge(Word.ON_TARGET if on_target else Word.MOVING, said)
    if found is Word.ON_TARGET:
        if live.target_stamp is None or live.stamp - live.target_stamp > _SEEN * 1e9:
            return Badge(Word.MOVING, "the target is not seen; its prediction is followed")
        if live.error is None or live.error > _ON_TARGET:
            return Badge(Word.MOVING, "the head turns after the target")
    return Badge(found, reason)
