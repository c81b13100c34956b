import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.tracking.joint_controller import JointMotion, MotionLimits
from head_tracking.transforms import JointLimits

LIMITS = MotionLimits(speed=5.0, acceleration=50.0, jerk=3000.0)
JOINT = JointLimits(-1.5, 1.5)
DT = 0.02


def run(wanted, seconds, limits=LIMITS, motion=None, joint=JOINT):
    motion = motion or JointMotion(0.0)
    trace = []
    for k in range(int(seconds / DT)):
        t = k * DT
        velocity = (wanted(t + DT) - wanted(t)) / DT
        motion.steer(wanted(t), velocity, DT, DT, limits, joint)
        trace.append((t, motion.position, motion.velocity))
        motion.advance(DT)
    return motion, trace


def test_a_motion_that_the_limits_allow_is_copied():
    wanted = lambda t: math.sin(2.0 * t)  # noqa: E731
    _, trace = run(wanted, 5.0)
    assert max(abs(position - wanted(t)) for t, position, _ in trace if t > 1.0) < 2e-3


def test_a_step_is_made_without_overshoot():
    motion, trace = run(lambda t: 1.0, 2.0)
    assert motion.position == pytest.approx(1.0, abs=1e-3)
    assert max(position for _, position, _ in trace) < 1.005


def test_the_end_of_the_range_is_never_passed():
    _, trace = run(lambda t: 3.0 * math.sin(6.0 * t), 4.0)
    assert max(abs(position) for _, position, _ in trace) <= 1.5 + 1e-9


def test_at_rest_nothing_moves():
    motion = JointMotion(0.3, 1.0)
    motion.rest_at(0.3)
    motion.steer(0.3, 0.0, DT, DT, LIMITS, JOINT)
    assert (motion.position, motion.velocity) == (0.3, 0.0)


@given(
    st.lists(st.floats(-4.0, 4.0), min_size=1, max_size=40),
    st.floats(0.1, 6.0),
    st.floats(2.0, 100.0),
)
def test_speed_acceleration_and_range_are_kept_whatever_is_wanted(wishes, speed, acceleration):
    limits = MotionLimits(speed, acceleration, 1e4)
    motion = JointMotion(0.0)
    for wish in wishes:
        for _ in range(3):
            before = motion.velocity
            motion.steer(wish, 0.0, DT, DT, limits, JOINT)
            motion.advance(DT)
            assert abs(motion.velocity) <= speed + 1e-9
            assert -1.5 - 1e-9 <= motion.position <= 1.5 + 1e-9
            # braking at the end of the range comes first
            assert abs(motion.velocity - before) <= acceleration * DT * 1.7 + 1e-9
