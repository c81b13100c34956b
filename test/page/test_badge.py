"""The badge: one word, and it is true."""

from dataclasses import replace

import pytest

from head_tracking.page.badge import Word, badge
from head_tracking.page.joint_control import Servo
from head_tracking.recording.recording import Observation
from head_tracking.ros.kit.diagnostics import Health, Level

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


def word(live=LIVE, health=(), servos=ON, *, stopped=False, on=True, complaint="") -> Word:
    return badge(live, health, servos, stopped=stopped, on=on, complaint=complaint).word


def says(state: str) -> Observation:
    return replace(LIVE, state=f"head_tracker: {state}")


def test_what_the_node_that_turns_the_head_says():
    assert word() is Word.ON_TARGET
    assert word(says("acquiring: a new target has come")) is Word.MOVING
    assert word(says("holding: the target is lost")) is Word.HOLDING
    assert word(says("idle: no target has come yet")) is Word.HOLDING
    assert word(says("stalled: pan does not follow")) is Word.FAULT


def test_a_head_that_misses_its_target_is_not_on_it_whatever_is_said():
    assert word(replace(LIVE, error=0.09)) is Word.MOVING
    assert word(replace(LIVE, error=None)) is Word.MOVING


def test_a_head_is_not_on_a_target_that_is_hidden():
    """The points of a hidden person end, or come so late that the tracker refuses them."""
    assert word(replace(LIVE, target_stamp=LIVE.stamp - SECOND)) is Word.MOVING
    assert word(replace(LIVE, target_stamp=None)) is Word.MOVING


@pytest.mark.parametrize("state", ["tracking: the head is on the target", "acquiring: it turns"])
def test_nothing_is_on_the_target_that_is_stopped_relaxed_broken_or_unheard_of(state):
    live = says(state)
    assert word(live, stopped=True) is Word.STOPPED
    assert word(live, servos=OFF) is Word.RELAXED
    assert word(live, [OVERLOAD]) is Word.FAULT
    assert word(replace(live, silent_joints=("pan",))) is Word.DISCONNECTED
    assert word(replace(live, joints={})) is Word.DISCONNECTED
    assert word(live, on=False) is Word.HOLDING


def test_a_refusal_says_why():
    live = says("holding: it is lost; targets are refused: it is behind the head")
    found = badge(live, (), ON, stopped=False, on=True)
    assert found == (Word.REFUSED, "it is behind the head")
    for state, shown in (
        ("tracking: the head is on the target", Word.ON_TARGET),
        ("acquiring: the head turns to the target", Word.MOVING),
        ("coasting: no point comes; the prediction is followed", Word.MOVING),
    ):
        late = says(f"{state}; targets are refused: the point is too old")
        assert word(late) is shown, "one point among many"
    pointed = Observation(1, {"pan": 0.0}, error=0.0, state="point_head: arrived")
    found = badge(pointed, (), ON, stopped=False, on=True, complaint="refused: out of reach")
    assert found == (Word.REFUSED, "refused: out of reach")
    assert word(pointed, complaint="did not arrive") is Word.HOLDING


def test_a_node_that_publishes_no_state_is_judged_by_its_error():
    live = replace(LIVE, state="point_head: turning")
    assert word(replace(live, error=0.3)) is Word.MOVING
    assert word(replace(live, error=0.01)) is Word.ON_TARGET
    assert word(replace(live, error=None)) is Word.HOLDING


def test_the_worst_that_is_true_is_said():
    live = replace(LIVE, silent_joints=("pan",))
    assert word(live, [OVERLOAD], OFF, stopped=True) is Word.DISCONNECTED
    assert word(LIVE, [OVERLOAD], OFF, stopped=True) is Word.STOPPED
    assert word(LIVE, [OVERLOAD], OFF) is Word.FAULT
