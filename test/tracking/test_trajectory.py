"""Trajectories as joint_trajectory_controller understands them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.tracking import (
    JointPoint,
    JointTrajectory,
    Tolerances,
    TrajectoryCode,
    TrajectoryError,
    Waypoint,
    checked_waypoints,
)
from head_tracking.transforms import JointLimits

PAN, TILT = JOINTS = ("pan", "tilt")
LIMITS = {PAN: JointLimits(-2.0, 2.0), TILT: JointLimits(-1.0, 1.0)}
AT_REST = {PAN: JointPoint(0.0), TILT: JointPoint(0.5)}
USUAL = Tolerances({PAN: 0.1, TILT: 0.1}, {PAN: 0.02, TILT: 0.02}, 1.0)
NOW = 1_700_000_000.0

finite = st.floats(-0.9, 0.9)


def trajectory(*waypoints, names=JOINTS, start=NOW, now=NOW, present=None, tolerances=USUAL):
    return JointTrajectory(names, waypoints, start, now, present or AT_REST, LIMITS, tolerances)


def slope(made, time, joint=0, step=1e-4):
    before, after = made.at(time - step)[joint], made.at(time + step)[joint]
    return (after.position - before.position) / (2.0 * step)


def test_positions_alone_are_joined_by_straight_lines():
    made = trajectory(Waypoint(1.0, (0.4, 0.5)), Waypoint(3.0, (0.8, 0.1)))
    assert made.at(NOW + 0.5)[0].position == pytest.approx(0.2)
    assert made.at(NOW + 2.0)[0] == pytest.approx((0.6, 0.2, 0.0), abs=1e-6)
    assert made.at(NOW + 2.0)[1] == pytest.approx((0.3, -0.2, 0.0), abs=1e-6)
    assert made.end == NOW + 3.0
    assert made.at(NOW + 9.0)[1].position == 0.1


@given(*[st.tuples(finite, finite, finite) for _ in range(3)], st.floats(0.2, 5.0), st.booleans())
def test_what_is_given_is_met_and_what_lies_between_is_its_derivative(a, b, c, duration, quintic):
    points = [
        Waypoint(
            duration * number,
            (position, 0.0),
            (velocity, 0.0),
            (acceleration, 0.0) if quintic else (),
        )
        for number, (position, velocity, acceleration) in enumerate((a, b, c), 1)
    ]
    made = JointTrajectory(
        JOINTS, points, 0.0, 0.0, AT_REST, dict.fromkeys(JOINTS, JointLimits()), USUAL
    )
    for point in points:
        just_before = made.at(point.time - 1e-9)[0]
        assert just_before.position == pytest.approx(point.positions[0], abs=1e-6)
        assert just_before.velocity == pytest.approx(point.velocities[0], abs=1e-6)
        if quintic:
            assert just_before.acceleration == pytest.approx(point.accelerations[0], abs=1e-4)
    for time in (0.3, 1.4, 2.7):
        point = made.at(time * duration)[0]
        assert point.velocity == pytest.approx(slope(made, time * duration), rel=1e-3, abs=1e-3)


def test_a_moving_joint_goes_on_smoothly():
    present = {PAN: JointPoint(0.3, 0.8), TILT: JointPoint(0.0)}
    made = trajectory(Waypoint(1.0, (1.0, 0.0), (0.0, 0.0)), present=present)
    assert made.at(NOW)[0].position == pytest.approx(0.3)
    assert slope(made, NOW + 1e-3) == pytest.approx(0.8, abs=0.01)


def test_the_other_joint_stays():
    made = trajectory(Waypoint(1.0, (1.0,)), names=(PAN,))
    assert made.at(NOW + 0.7)[1] == (0.5, 0.0, 0.0)
    assert made.judge(NOW + 1.0, (1.0, -0.9), NOW + 1.0).code is TrajectoryCode.SUCCESSFUL


def test_a_start_in_the_future_is_waited_for_and_what_is_over_is_left_out():
    later = trajectory(Waypoint(1.0, (1.0, 0.5)), start=NOW + 2.0)
    assert later.at(NOW + 1.9)[0].position == 0.0
    assert later.at(NOW + 2.5)[0].position == pytest.approx(0.5)
    begun = trajectory(Waypoint(1.0, (1.0, 0.5)), Waypoint(2.0, (-1.0, 0.5)), start=NOW - 1.5)
    assert begun.at(NOW + 0.25)[0].position == pytest.approx(-0.5)
    assert begun.end == NOW + 0.5
    with pytest.raises(TrajectoryError) as error:
        trajectory(Waypoint(1.0, (1.0, 0.5)), start=NOW - 1.5)
    assert error.value.code is TrajectoryCode.OLD_HEADER_TIMESTAMP


def test_a_moving_joint_brakes_and_waits_for_a_start_in_the_future():
    present = {PAN: JointPoint(0.0, 1.5), TILT: JointPoint(0.0)}
    made = trajectory(Waypoint(1.0, (0.0, 0.5)), start=NOW + 60.0, present=present)
    assert slope(made, NOW + 1e-3) == pytest.approx(1.5, abs=0.02)
    assert max(abs(made.at(NOW + 0.05 * k)[0].position) for k in range(1200)) < 0.15
    assert made.at(NOW + 59.0)[0].velocity == 0.0


def test_a_point_for_now_is_now_and_nothing_is_where_it_is():
    made = trajectory(Waypoint(0.0, (1.0, 0.0)))
    assert made.at(NOW)[0].position == 1.0
    empty = trajectory(names=())
    assert empty.at(NOW + 3.0)[1].position == 0.5
    assert empty.judge(NOW, (0.0, 0.0), NOW).code is TrajectoryCode.SUCCESSFUL


def test_a_spline_that_leaves_the_range_is_kept_in_it():
    made = trajectory(Waypoint(1.0, (1.9, 0.5), (0.0, 0.0)), Waypoint(2.0, (1.9, 0.5), (-9.0, 0.0)))
    assert max(made.at(NOW + 0.01 * k)[0].position for k in range(201)) == 2.0


def test_tolerances_decide():
    made = trajectory(Waypoint(1.0, (1.0, 0.5)))
    assert made.judge(NOW + 0.5, (0.45, 0.5), NOW + 0.52) is None
    off = made.judge(NOW + 0.5, (0.35, 0.5), NOW + 0.52)
    assert off.code is TrajectoryCode.PATH_TOLERANCE_VIOLATED
    assert off.text.startswith(PAN)
    assert len(made.judge(NOW + 0.5, (1e308, 0.5), NOW + 0.52).text) < 100
    assert made.judge(NOW + 1.2, (0.9, 0.5), NOW + 1.2) is None
    late = made.judge(NOW + 2.1, (0.9, 0.5), NOW + 2.1)
    assert late.code is TrajectoryCode.GOAL_TOLERANCE_VIOLATED
    assert made.judge(NOW + 2.1, (0.99, 0.5), NOW + 2.1).code is TrajectoryCode.SUCCESSFUL
    free = Tolerances(dict.fromkeys(JOINTS, math.inf), dict.fromkeys(JOINTS, math.inf), 0.0)
    anything = trajectory(Waypoint(1.0, (1.0, 0.5)), tolerances=free)
    assert anything.judge(NOW + 1.0, (-1.0, -1.0), NOW + 1.0).code is TrajectoryCode.SUCCESSFUL


@pytest.mark.parametrize(
    ("names", "points", "code"),
    [
        (("nose",), [Waypoint(1.0, (0.0,))], -2),
        ((), [Waypoint(1.0, ())], -2),
        ((PAN, PAN), [Waypoint(1.0, (0.0, 0.0))], -2),
        (JOINTS, [Waypoint(1.0, (0.0,))], -1),
        (JOINTS, [Waypoint(1.0, (0.0, 0.0), (1.0,))], -1),
        (JOINTS, [Waypoint(1.0, (0.0, math.nan))], -1),
        (JOINTS, [Waypoint(1.0, (0.0, 0.0), (0.0, math.inf))], -1),
        (JOINTS, [Waypoint(1.0, (0.0, 1.2))], -1),
        (JOINTS, [Waypoint(1.0, (0.0, 1e308))], -1),
        (JOINTS, [Waypoint(-1.0, (0.0, 0.0))], -1),
        (JOINTS, [Waypoint(1.0, (0.0, 0.0)), Waypoint(1.0, (0.0, 0.0))], -1),
    ],
)
def test_mistakes_have_their_codes(names, points, code):
    with pytest.raises(TrajectoryError) as error:
        checked_waypoints(names, points, LIMITS)
    assert error.value.code == code
    assert len(str(error.value)) < 150
