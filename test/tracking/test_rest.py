import pytest

from head_tracking.tracking.joint_controller import Reference, Rest

BAND = 0.004
STEP = 0.005


def settle(rest, reference, now=0.0, seconds=0.3, setpoint=0.3):
    for k in range(int(seconds / 0.02)):
        rest.judge(reference, 0.0, 0.0, setpoint, BAND, now + 0.02 * k)
    return rest


def test_a_joint_that_is_where_it_should_be_falls_silent():
    rest = settle(Rest(), Reference(0.3))
    assert rest.goal == 0.3


def test_not_at_once():
    rest = Rest()
    rest.judge(Reference(0.3), 0.0, 0.0, 0.3, BAND, 0.0)
    rest.judge(Reference(0.3), 0.0, 0.0, 0.3, BAND, 0.05)
    assert rest.goal is None
    assert rest.near


@pytest.mark.parametrize(
    ("velocity", "off", "speed"), [(0.1, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.1)]
)
def test_not_while_anything_moves_or_is_off(velocity, off, speed):
    rest = Rest()
    for k in range(50):
        rest.judge(Reference(0.3, velocity), off, speed, 0.3, BAND, 0.02 * k)
    assert rest.goal is None


def test_it_is_harder_to_leave_than_to_stay():
    rest = settle(Rest(), Reference(0.3))
    settle(rest, Reference(0.3 + 0.9 * BAND, 0.03), 0.3, 0.4)
    assert rest.goal == 0.3
    settle(rest, Reference(0.3 + 1.1 * BAND), 2.0, 0.04)
    assert rest.goal is None


def test_a_target_that_sets_off_wakes_it():
    rest = settle(Rest(), Reference(0.3))
    settle(rest, Reference(0.3, 0.1), 1.0, 0.04)
    assert rest.goal is None


def test_noise_widens_the_band_but_not_for_ever():
    noisy, wild = Reference(0.3, noise=0.003), Reference(0.3, noise=0.1)
    for reference, inside, outside in ((noisy, 0.012, 0.014), (wild, 0.015, 0.017)):
        rest = settle(Rest(), reference)
        settle(rest, Reference(0.3 + inside, noise=reference.noise), 0.3, 0.1)
        assert rest.goal is not None
        settle(rest, Reference(0.3 + outside, noise=reference.noise), 0.5, 0.04)
        assert rest.goal is None


def test_a_joint_that_stopped_short_is_helped_step_by_step():
    rest = settle(Rest(), Reference(0.3))
    rest.help(0.29, 0.25, BAND)
    assert rest.goal == 0.3  # not yet: it may still be on its way
    rest.help(0.29, 1.0, BAND)
    assert rest.goal == pytest.approx(0.31)
    rest.help(0.29, 1.1, BAND)
    assert rest.goal == pytest.approx(0.31)
    for now in (1.3, 1.6, 1.9, 2.2):
        rest.help(0.28, now, BAND)
    assert rest.goal == pytest.approx(0.315)  # no farther


def test_one_that_stands_well_enough_is_left_alone():
    """A coarse encoder never makes it hunt, however small a dead band was asked for."""
    rest = settle(Rest(), Reference(0.3))
    rest.help(0.3 - 0.7 * STEP, 5.0, 0.0)
    assert rest.goal == 0.3


def test_a_place_that_is_better_known_is_aimed_at_again_but_seldom():
    rest = settle(Rest(), Reference(0.3))
    goals = []
    for k in range(300):
        rest.judge(Reference(0.3 + 0.8 * BAND), 0.0, 0.0, 0.3, BAND, 1.0 + 0.02 * k)
        goals.append(rest.goal)
    assert goals[-1] == pytest.approx(0.3 + 0.8 * BAND, abs=0.5 * BAND)
    assert len(set(goals)) <= 3
