import pytest

from head_tracking.tracking.joint_controller import Reference, Rest

BAND = 0.004
STEP = 0.005


def settle(rest, reference, now=0.0, seconds=0.3, setpoint=0.3):
    for k in range(int(seconds / 0.02)):
        rest.judge(reference, 0.0, setpoint, BAND, now + 0.02 * k)
    return rest


def test_a_joint_that_stopped_short_is_helped_step_by_step():
    rest = settle(Rest(), Reference(0.3))
    rest.correct(0.29, 0.25, BAND)
    assert rest.goal == 0.3  # not yet: it may still be on its way
    rest.correct(0.29, 1.0, BAND)
    assert rest.goal == pytest.approx(0.31)
    rest.correct(0.29, 1.1, BAND)
    assert rest.goal == pytest.approx(0.31)
    for now in (1.3, 1.6, 1.9, 2.2):
        rest.correct(0.28, now, BAND)
    assert rest.goal == pytest.approx(0.315)  # no farther


@pytest.mark.parametrize("dead_band", [0.0, BAND])
@pytest.mark.parametrize("place", [0.3, 0.3024, 0.3026])
def test_a_coarse_encoder_never_makes_it_hunt(place, dead_band):
    rest = settle(Rest(), Reference(place))
    goals = []
    for k in range(600):
        measured = STEP * round(rest.goal / STEP)
        rest.correct(measured, 1.0 + 0.1 * k, dead_band)
        goals.append(rest.goal)
    assert abs(STEP * round(goals[-1] / STEP) - place) <= STEP
    assert len(set(goals)) <= 6
    assert len(set(goals[100:])) == 1


def test_a_joint_rests_only_at_a_target_that_does_not_move_by_itself():
    rest = settle(Rest(), Reference(0.3, unrest=1.0))
    assert rest.goal == 0.3
    assert settle(rest, Reference(0.3, unrest=1.8), 0.3).goal == 0.3
    assert settle(rest, Reference(0.3, unrest=2.5), 0.6).goal is None
    assert settle(rest, Reference(0.3, unrest=1.8), 0.9).goal is None
