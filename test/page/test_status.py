"""The status of a head in one word, and its faults."""

from dataclasses import replace

import pytest

from head_tracking.page.joint_control import Servo
from head_tracking.page.status import Word, advice, faults, head_status
from head_tracking.recording.recording import Observation
from head_tracking.ros.kit.diagnostics import FAULT, FaultName, Health, Level

SECOND = 10**9  # ns
LIVE = Observation(
    9 * SECOND,
    {"pan": 0.0},
    error=0.001,
    state="head_tracker: tracking: it is there",
    target_stamp=9 * SECOND - SECOND // 10,
)
ON = (Servo("pan_controller", "pan", True), Servo("tilt_controller", "tilt", True))
OFF = tuple(replace(servo, torque=False) for servo in ON)
OVERLOAD = Health("servo_bus: pan", Level.ERROR, "overload", {})
SILENT = Health("head_tracker: target", Level.STALE, "nothing heard", {FAULT: FaultName.SILENT})


def word(live=LIVE, health=(), servos=ON, *, stopped=False, enabled=True, complaint="") -> Word:
    status = head_status(
        live, health, servos, stopped=stopped, enabled=enabled, complaint=complaint
    )
    return status.word


def in_state(state: str) -> Observation:
    return replace(LIVE, state=f"head_tracker: {state}")


@pytest.mark.parametrize(
    ("live", "expected"),
    [
        (LIVE, Word.ON_TARGET),
        (in_state("acquiring: a new target has come"), Word.MOVING),
        (in_state("holding: the target is lost"), Word.HOLDING),
        (in_state("idle: no target has come yet"), Word.HOLDING),
        (in_state("stalled: pan does not follow"), Word.FAULT),
        # a head that misses a target, or does not see it, is not on it
        (replace(LIVE, error=0.09), Word.MOVING),
        (replace(LIVE, error=None), Word.MOVING),
        (replace(LIVE, target_stamp=LIVE.stamp - SECOND), Word.MOVING),
        (replace(LIVE, target_stamp=None), Word.MOVING),
        # a controller without a state is judged by its error
        (replace(LIVE, state="point_head: turning", error=0.3), Word.MOVING),
        (replace(LIVE, state="point_head: turning", error=0.01), Word.ON_TARGET),
        (replace(LIVE, state="point_head: turning", error=None), Word.HOLDING),
    ],
)
def test_the_word_follows_state_error_and_age_of_the_target(live, expected):
    assert word(live) is expected


@pytest.mark.parametrize("state", ["tracking: the head is on the target", "acquiring: it turns"])
def test_nothing_is_on_the_target_that_is_stopped_relaxed_faulty_or_silent(state):
    live = in_state(state)
    assert word(live, stopped=True) is Word.STOPPED
    assert word(live, servos=OFF) is Word.RELAXED
    assert word(live, [OVERLOAD]) is Word.FAULT
    assert word(replace(live, silent_joints=("pan",))) is Word.DISCONNECTED
    assert word(replace(live, joints={})) is Word.DISCONNECTED
    assert word(live, enabled=False) is Word.HOLDING


def test_a_refusal_has_its_reason_unless_it_concerns_one_point_of_many():
    live = in_state("holding: it is lost; targets are refused: it is behind the head")
    found = head_status(live, (), ON, stopped=False, enabled=True)
    assert found == (Word.REFUSED, "it is behind the head")
    for state, shown in (("tracking", Word.ON_TARGET), ("acquiring", Word.MOVING)):
        assert word(in_state(f"{state}: it turns; targets are refused: too old")) is shown
    pointed = Observation(1, {"pan": 0.0}, error=0.0, state="point_head: arrived")
    assert word(pointed, complaint="refused: out of reach") is Word.REFUSED
    assert word(pointed, complaint="did not arrive") is Word.HOLDING


def test_the_worst_condition_is_shown():
    live = replace(LIVE, silent_joints=("pan",))
    assert word(live, [OVERLOAD], OFF, stopped=True) is Word.DISCONNECTED
    assert word(LIVE, [OVERLOAD], OFF, stopped=True) is Word.STOPPED
    assert word(LIVE, [OVERLOAD], OFF) is Word.FAULT


@pytest.mark.parametrize(
    ("level", "fault", "command"),
    [
        (Level.ERROR, "no port", ""),
        (Level.ERROR, "no answer", ""),
        (Level.ERROR, "overload", "recover"),
        (Level.ERROR, "torque lost, overheating", "recover"),
        (Level.ERROR, "input voltage", "recover"),
        (Level.ERROR, "hot", ""),
        (Level.STALE, "silent", ""),
    ],
)
def test_a_fault_has_advice_and_the_command_that_may_help(level, fault, command):
    (shown,) = faults([Health("servo_bus: pan", level, "a text", {FAULT: fault})], Observation(0))
    assert shown.text == "pan: a text"
    assert shown.command == command
    assert shown.advice != advice("none", "servo_bus")[0]


@pytest.mark.parametrize("level", [Level.OK, Level.WARN])
def test_a_warning_is_no_fault(level):
    slow = Health("servo_bus: bus", level, "45 of 50 cycles per second", {})
    assert faults([slow], Observation(0)) == []


def test_a_node_that_has_gone_or_is_silent_is_named_once():
    (fault,) = faults([SILENT], Observation(0))
    assert "head_tracker" in fault.advice
    (fault,) = faults([SILENT], Observation(0, missing_nodes=("head_tracker",)))
    assert "head_tracker" in fault.text
    (fault,) = faults([], Observation(0, silent_joints=("head_pan_joint",)))
    assert "head_pan_joint" in fault.text
