from head_tracking.gaze import together


def test_both_joints_arrive_together():
    command = together((0.0, 0.0), (1.0, -0.25), 2.0)
    assert (command.pan_speed, command.tilt_speed) == (2.0, 0.5)


def test_a_joint_that_need_not_move_still_has_a_speed_above_zero():
    command = together((0.0, 0.3), (1.0, 0.3), 2.0)
    assert command.tilt_speed > 0
    assert together((0.1, 0.1), (0.1, 0.1), 2.0).pan_speed > 0
