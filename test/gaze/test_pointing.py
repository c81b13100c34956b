import math

import pytest

from head_tracking.gaze import (
    GazeStatus,
    PanTiltHead,
    Pointing,
    PointingParameters,
    together,
)

PAN, TILT = "head_pan_joint", "head_tilt_joint"


@pytest.fixture
def pointing(kinectbot):
    head = PanTiltHead(kinectbot, PAN, TILT, "camera_link")
    return Pointing(head, PointingParameters())


def test_both_joints_arrive_together():
    command = together((0.0, 0.0), (1.0, -0.25), 2.0)
    assert (command.pan_speed, command.tilt_speed) == (2.0, 0.5)


def test_a_joint_that_need_not_move_still_has_a_speed_above_zero():
    command = together((0.0, 0.3), (1.0, 0.3), 2.0)
    assert command.tilt_speed > 0
    assert together((0.1, 0.1), (0.1, 0.1), 2.0).pan_speed > 0


def test_arrival_is_judged_by_the_measured_joints(pointing):
    gaze, command = pointing.point_at((1.0, 0.5, 0.0), (0.0, 0.0), 0.0)
    assert gaze.reached
    assert pointing.judge((0.3, 0.0), 0.1) is None  # on its way
    here = (command.pan + 0.004, command.tilt)
    assert pointing.judge(here, 0.4) is None  # just stopped
    result = pointing.judge(here, 0.9)
    assert result.arrived
    assert result.miss == pytest.approx(0.004, rel=0.3)
    assert pointing.judge(here, 2.0) is None  # said once
    assert str(result).startswith("arrived: the head misses the target by 0.2")


def test_a_head_that_is_held_did_not_arrive(pointing):
    pointing.point_at((1.0, 0.5, 0.0), (0.0, 0.0), 0.0)
    assert pointing.judge((0.1, 0.0), 0.1) is None
    result = pointing.judge((0.1, 0.0), 1.0)
    assert not result.arrived
    assert result.miss > 0.2


def test_a_head_that_has_not_moved_yet_is_waited_for(pointing):
    """Its torque may come on late."""
    _, command = pointing.point_at((1.0, 0.5, 0.0), (0.0, 0.0), 0.0)
    assert pointing.judge((0.0, 0.0), 1.0) is None
    assert pointing.judge((command.pan, command.tilt), 1.3) is None
    assert pointing.judge((command.pan, command.tilt), 1.8).arrived
    pointing.point_at((1.0, -0.5, 0.0), (command.pan, command.tilt), 2.0)
    assert not pointing.judge((command.pan, command.tilt), 3.5).arrived


def test_a_new_target_on_the_way_is_judged_anew(pointing):
    pointing.point_at((1.0, 0.5, 0.0), (0.0, 0.0), 0.0)
    _, command = pointing.point_at((1.0, -0.5, 0.0), (0.2, 0.0), 0.2)
    assert pointing.judge((command.pan, command.tilt), 0.7) is None
    assert pointing.judge((command.pan, command.tilt), 1.2).arrived


@pytest.mark.parametrize(
    ("target", "status"),
    [
        ((-2.0, 0.0, 0.0), GazeStatus.OUT_OF_REACH),
        ((0.0115, 0.0, 2.0), GazeStatus.ON_PAN_AXIS),
        ((0.05, 0.0, 0.1), GazeStatus.TOO_CLOSE),
        ((math.nan, 0.0, 0.0), GazeStatus.NOT_FINITE),
    ],
)
def test_an_impossible_target_moves_nothing_and_says_why(pointing, target, status):
    gaze, command = pointing.point_at(target, (0.3, 0.1), 0.0)
    assert gaze.status is status
    assert gaze.reason
    assert command is None
    assert pointing.miss((0.3, 0.1)) is None


def test_on_request_it_turns_as_far_as_the_joints_go(kinectbot):
    head = PanTiltHead(kinectbot, PAN, TILT, "camera_link")
    pointing = Pointing(head, PointingParameters(clamp_to_limits=True))
    gaze, command = pointing.point_at((-2.0, 0.5, 0.0), (0.0, 0.0), 0.0)
    assert command.pan == 2.6
    pointing.judge((2.6, command.tilt), 1.0)
    result = pointing.judge((2.6, command.tilt), 2.0)
    assert not result.arrived
    assert result.miss == pytest.approx(gaze.miss)


def test_recentring(pointing):
    command = pointing.recenter((1.0, 0.5), 0.0)
    assert (command.pan, command.tilt) == (0.0, 0.0)
    assert pointing.miss((0.0, 0.0)) is None


def test_it_starts_from_the_command_and_not_from_the_encoder(pointing):
    """A target a little above the axis, sent again and again, raises the head in small steps."""
    tick = math.radians(300) / 1024
    tilt = 0.0
    for step in range(10):
        encoder = (0.0, round(tilt / tick) * tick)
        start = pointing.start_from(encoder)
        T_base_head = pointing.head
        above = _in_base(T_base_head, start, (5.0, 0.0, 0.01))
        _, command = pointing.point_at(above, encoder, float(step))
        assert command.tilt < tilt
        tilt = command.tilt
    assert tilt == pytest.approx(-10 * math.atan(0.01 / 4.91), rel=0.02)


def test_far_from_the_command_it_starts_from_the_encoder(pointing):
    pointing.point_at((1.0, 0.5, 0.0), (0.0, 0.0), 0.0)
    assert pointing.start_from((0.1, 0.0)) == (0.1, 0.0)


@pytest.fixture(autouse=True)
def _model(kinectbot):
    _in_base.model = kinectbot


def _in_base(head, positions, point):
    pan, tilt = positions
    return _in_base.model.transform(head.base_frame, "head_link", {PAN: pan, TILT: tilt}) @ point
