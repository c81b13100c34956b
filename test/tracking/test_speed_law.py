import pytest

from head_tracking.tracking import SpeedLaw, SpeedLawParameters
from head_tracking.transforms import JointLimits

LIMITS = (JointLimits(-2.6, 2.6), JointLimits(-1.0, 1.0))


@pytest.fixture
def law():
    return SpeedLaw(SpeedLawParameters())


def test_speed_is_proportional_to_the_error_and_the_goal_leads(law):
    command = law.step((0.2, -0.1), (0.0, 0.0), LIMITS)
    assert command.pan_speed == pytest.approx(1.5 * 0.2)
    assert command.tilt_speed == pytest.approx(1.5 * 0.1)
    assert (command.pan, command.tilt) == (0.5, -0.5)


def test_speed_is_capped(law):
    assert law.step((2.0, 0.0), (0.0, 0.0), LIMITS).pan_speed == 0.5


def test_the_goal_stays_inside_the_limits(law):
    command = law.step((2.5, 0.9), (2.4, 0.8), LIMITS)
    assert (command.pan, command.tilt) == (2.6, 1.0)


def test_inside_the_threshold_the_joint_stays_where_it_stopped(law):
    law.step((0.2, 0.2), (0.0, 0.0), LIMITS)
    assert law.step((0.2, 0.2), (0.195, 0.195), LIMITS).pan == 0.195
    # it sags by less than the threshold: the goal does not follow the sag
    assert law.step((0.2, 0.2), (0.191, 0.191), LIMITS).pan == 0.195
    assert law.step((0.2, 0.2), (0.1, 0.191), LIMITS).pan == pytest.approx(0.6)


def test_speeds_are_never_zero(law):
    for error in (0.0, 1e-9, 0.0100001, 0.5):
        command = law.step((error, -error), (0.0, 0.0), LIMITS)
        assert command.pan_speed > 0
        assert command.tilt_speed > 0


def test_if_nobody_speaks_any_more_the_head_travels_no_farther_than_the_lead(law):
    command = law.step((2.5, 0.0), (0.3, 0.0), LIMITS)
    assert abs(command.pan - 0.3) <= 0.5
