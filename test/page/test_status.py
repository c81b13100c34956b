"""The status of a head in one word, and its faults."""

from dataclasses import replace

import pytest

from head_tracking.page.joint_control import JointServo
from head_tracking.page.status import Word, advice, faults, head_status
from head_tracking.recording.recording import Observation
from head_tracking.ros.kit.diagnostics import FAULT, FaultName, Level, Part

SECOND = 10**9  # ns
LIVE = Observation(
    9 * SECOND,
    {"pan": 0.0},
    error=0.001,
    controller="head_tracker",
    state="tracking",
    target_stamp=9 * SECOND - SECOND // 10,
)
ON = (JointServo("pan_controller", "pan", True), JointServo("tilt_controller", "tilt", True))
OFF = tuple(replace(servo, torque=False) for servo in ON)
OVERLOAD = Part("servo_bus: pan", Level.ERROR, "overload", {})
SILENT = Part("head_tracker: target", Level.STALE, "nothing heard", {FAULT: FaultName.SILENT})


POINTED = replace(LIVE, controller="point_head", state="holding", target_stamp=None)


def word(live=LIVE, health=(), servos=ON, *, stopped=False, silent=()) -> Word:
    return head_status(live, health, servos, silent, stopped=stopped).word


@pytest.mark.parametrize(
    ("live", "expected"),
    [
        (LIVE, Word.ON_TARGET),
        (replace(LIVE, state="acquiring"), Word.MOVING),
        (replace(LIVE, state="idle"), Word.HOLDING),
        (replace(LIVE, state="stalled"), Word.FAULT),
        (replace(LIVE, state="at the limit"), Word.AT_LIMIT),
        (replace(LIVE, controller=""), Word.HOLDING),
        (replace(LIVE, joints={}), Word.DISCONNECTED),
        # a head that misses a target, or does not see it, is not on it
        (replace(LIVE, error=0.09), Word.MOVING),
        (replace(LIVE, error=None), Word.MOVING),
        (replace(LIVE, target_stamp=LIVE.stamp - SECOND), Word.MOVING),
        (replace(POINTED, error=0.3), Word.MOVING),
        (POINTED, Word.ON_TARGET),
        (replace(POINTED, error=None), Word.HOLDING),
        (replace(POINTED, refusal="out of reach"), Word.REFUSED),
        # one of many points is refused
        (replace(LIVE, refusal="too old"), Word.ON_TARGET),
        (replace(LIVE, refusal="too old", state="holding"), Word.REFUSED),
    ],
)
def test_the_word_follows_state_error_and_age_of_the_target(live, expected):
    assert word(live) is expected


@pytest.mark.parametrize(
    ("silent", "stopped", "health", "expected"),
    [
        (("pan",), True, [OVERLOAD], Word.DISCONNECTED),
        ((), True, [OVERLOAD], Word.STOPPED),
        ((), False, [OVERLOAD], Word.FAULT),
        ((), False, [], Word.RELAXED),
    ],
)
def test_the_worst_condition_is_shown(silent, stopped, health, expected):
    assert word(LIVE, health, OFF, stopped=stopped, silent=silent) is expected


@pytest.mark.parametrize(
    ("level", "fault", "command"),
    [
        (Level.ERROR, "no port", ""),
        (Level.ERROR, "torque lost, overheating", "recover"),
        (Level.STALE, "silent", ""),
    ],
)
def test_a_fault_has_advice_and_the_command_that_may_help(level, fault, command):
    (shown,) = faults([Part("servo_bus: pan", level, "a text", {FAULT: fault})])
    assert "pan: a text" in shown.text
    assert shown.command == command
    assert shown.advice != advice("none", "servo_bus")[0]
    if command:  # a stopped head refuses it
        assert ("STOP" in shown.advice) == ("Resume" in shown.advice)


def test_a_node_that_has_gone_or_is_silent_is_named_once():
    (fault,) = faults([SILENT])
    assert "head_tracker" in fault.advice
    (fault,) = faults([SILENT], missing=("head_tracker",))
    assert "head_tracker" in fault.text
    (fault,) = faults([], silent=("head_pan_joint",))
    assert "head_pan_joint" in fault.text


@pytest.mark.parametrize(
    ("state", "is_named"), [("idle", True), ("holding", True), ("tracking", False)]
)
def test_what_the_camera_does_not_see_is_named(state, is_named):
    live = replace(LIVE, state=state, refusal="too old")  # of what was followed before
    found = head_status(live, (), ON, stopped=False, sought="face")
    assert ("face" in found.reason) is is_named is (found.word is Word.WAITING)
    blind = head_status(live, (), ON, stopped=False, sought="face", has_camera=False)
    assert (blind.reason != found.reason) is is_named
