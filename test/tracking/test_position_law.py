import pytest

from head_tracking.tracking import (
    EstimatorParameters,
    JointReading,
    PositionLaw,
    SpeedLimits,
    TargetEstimator,
)

READING = JointReading(0.0, (0.2, 0.1))


@pytest.fixture
def estimate(head):
    def make(point):
        estimator = TargetEstimator(EstimatorParameters())
        estimator.add(0.0, head.sight(point, 0.0, 0.0), 0.0)
        return estimator.estimate

    return make


@pytest.fixture
def law(head):
    return PositionLaw(head, 0.02, SpeedLimits(max_joint_speed=2.0))


def test_the_goal_is_where_the_target_is(law, head, estimate):
    command, gaze = law.follow(estimate((1.0, 1.0, 0.5)), READING, 0.0)
    assert (command.pan, command.tilt) == (gaze.pan, gaze.tilt)
    assert max(command.pan_speed, command.tilt_speed) == 2.0


def test_both_joints_arrive_together(law, estimate):
    command, _ = law.follow(estimate((1.0, 1.0, 0.5)), READING, 0.0)
    ways = abs(command.pan - 0.2), abs(command.tilt - 0.1)
    assert ways[0] / command.pan_speed == pytest.approx(ways[1] / command.tilt_speed)


def test_it_goes_along_the_limit_to_a_target_out_of_reach(law, head, estimate):
    command, gaze = law.follow(estimate((-2.0, 0.5, 0.0)), READING, 0.0)
    assert not gaze.reached
    assert command.pan == head.pan_limits.upper


def test_it_stops_where_it_is(law):
    command = law.stop(READING)
    assert (command.pan, command.tilt) == READING.positions
