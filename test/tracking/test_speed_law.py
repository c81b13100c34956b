import pytest

from head_tracking.tracking import (
    EstimatorParameters,
    JointReading,
    SpeedLaw,
    SpeedLimits,
    TargetEstimator,
)


@pytest.fixture
def law(head):
    return SpeedLaw(head, 0.1)


@pytest.fixture
def estimate(head):
    def make(point):
        estimator = TargetEstimator(EstimatorParameters())
        estimator.add(0.0, head.sight(point, 0.0, 0.0), 0.0)
        return estimator.estimate

    return make


def test_names_and_defaults_are_the_tutorials(law):
    p = law.parameters
    assert (p.k_pan, p.k_tilt) == (1.5, 1.5)
    assert (p.pan_threshold, p.tilt_threshold) == (0.01, 0.01)
    assert law.limits.lead_target_angle == 0.5


def test_it_aims_at_the_newest_point(law, head, estimate):
    command, gaze = law.follow(estimate((1.0, 0.5, 0.2)), JointReading(0.0, (0.0, 0.0)), 0.0)
    exact = head.gaze((1.0, 0.5, 0.2), 0.0, 0.0)
    assert (gaze.pan, gaze.tilt) == pytest.approx((exact.pan, exact.tilt))
    assert command.pan_speed == pytest.approx(min(0.5, 1.5 * gaze.pan))


def test_a_cap_that_was_set_is_kept(head):
    law = SpeedLaw(head, 0.1, SpeedLimits(max_joint_speed=0.2))
    assert law.step((2.0, 0.0), (0.0, 0.0)).pan_speed == 0.2


def test_a_target_out_of_reach_stops_it_where_it_was(law, estimate):
    behind = estimate((-2.0, 0.0, 0.0))
    first, gaze = law.follow(behind, JointReading(0.0, (0.5, 0.0)), 0.0)
    assert "out of reach" in gaze.reason
    again, _ = law.follow(behind, JointReading(0.1, (0.6, 0.0)), 0.1)
    assert (first.pan, again.pan) == (0.5, 0.5)


def test_it_goes_and_stops(law):
    reading = JointReading(0.0, (0.3, 0.1))
    assert law.go_to((0.0, 0.0), 0.3, reading, 0.0).pan_speed == 0.3
    stopped = law.stop(reading)
    assert (stopped.pan, stopped.tilt) == (0.3, 0.1)


def test_speed_is_proportional_to_the_error_and_the_goal_leads(law):
    command = law.step((0.2, -0.1), (0.0, 0.0))
    assert command.pan_speed == pytest.approx(1.5 * 0.2)
    assert command.tilt_speed == pytest.approx(1.5 * 0.1)
    assert (command.pan, command.tilt) == (0.5, -0.5)


def test_speed_is_capped(law):
    assert law.step((2.0, 0.0), (0.0, 0.0)).pan_speed == 0.5


def test_the_goal_stays_inside_the_limits(law):
    command = law.step((2.5, 1.3), (2.4, 1.2))
    assert (command.pan, command.tilt) == (2.6, 1.47)


def test_inside_the_threshold_the_joint_stays_where_it_stopped(law):
    law.step((0.2, 0.2), (0.0, 0.0))
    assert law.step((0.2, 0.2), (0.195, 0.195)).pan == 0.195
    # it sags by less than the threshold: the goal does not follow the sag
    assert law.step((0.2, 0.2), (0.191, 0.191)).pan == 0.195
    assert law.step((0.2, 0.2), (0.1, 0.191)).pan == pytest.approx(0.6)


def test_speeds_are_never_zero(law):
    for error in (0.0, 1e-9, 0.0100001, 0.5):
        command = law.step((error, -error), (0.0, 0.0))
        assert command.pan_speed > 0
        assert command.tilt_speed > 0


def test_if_nobody_speaks_any_more_the_head_travels_no_farther_than_the_lead(law):
    command = law.step((2.5, 0.0), (0.3, 0.0))
    assert abs(command.pan - 0.3) <= 0.5
