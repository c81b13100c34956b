"""Whether a joint follows its commands, from goals, speeds and measured positions."""

from head_tracking.tracking import FollowingWatch

DT = 0.02


def watched(position, goal=lambda t: 1.0, speed=0.5, seconds=2.0, patience=0.8):
    """What a watch reports at every reading."""
    watch = FollowingWatch("pan", patience)
    return [
        watch.check(goal(k * DT), speed, position(k * DT), k * DT) for k in range(int(seconds / DT))
    ]


def test_it_follows_again_once_it_moves():
    problems = watched(lambda t: max(0.0, t - 2.0), seconds=3.0)
    assert problems[99]
    assert not problems[107]  # it has moved by 0.14 rad
    assert not problems[-1]


def test_a_goal_on_the_other_side_starts_anew():
    problems = watched(lambda t: 0.0, goal=lambda t: 1.0 if t < 1.5 else -1.0, seconds=2.0)
    assert problems[74]
    assert not problems[75]
    assert not problems[-1]
