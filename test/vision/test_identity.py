import numpy as np
import pytest
from people import crossed, replaced, returned

from head_tracking.transforms import Rotation, Transform
from head_tracking.vision import (
    Box,
    Candidate,
    DistanceParameters,
    IdentityParameters,
    Located,
    VisualTracker,
)

STILL = Transform.identity()


def seen(x, z=2.0, confidence=0.9, label="", colour=0):
    looks = np.zeros(4, np.float32)
    looks[colour] = 1.0
    box = Box(250 + 250 * x - 20, 240, 40, 40)
    return Located(Candidate(box, box.centre, confidence, label), (x, 0.0, z), True, 0.04, looks)


def follow(tracker, frames, start=0.0, period=1 / 30):
    """The number of the target in each frame; None if there is none."""
    followed = []
    for i, found in enumerate(frames):
        sighting = tracker.update(round((1.0 + start + i * period) * 1e9), found, STILL)
        followed.append(None if sighting is None else sighting.number)
    return followed


@pytest.fixture
def tracker():
    return VisualTracker(None, DistanceParameters(), IdentityParameters())


def test_the_larger_of_two_is_chosen_and_kept(tracker):
    big, small = seen(-0.3), seen(0.3)
    big = Located(
        Candidate(big.candidate.box._replace(width=60), big.candidate.centre, 0.9), big.point, True
    )
    numbers = follow(tracker, [[small, big]] * 4 + [[small]] * 10 + [[small, big]] * 5)
    assert numbers[2] == numbers[-1] is not None
    assert numbers[4:14] == [None] * 10, "no jump to the other one"


@pytest.mark.parametrize("rate", [30, 10, 5])
def test_the_speed_of_something_is_not_overestimated_when_images_are_rare(tracker, rate):
    follow(tracker, [[seen(-1.0 + 0.4 * i / rate)] for i in range(4 * rate)], period=1 / rate)
    assert tracker.followed.velocity[0] == pytest.approx(0.4, rel=0.01)


@pytest.mark.parametrize("gap", [0.3, 1.9])
@pytest.mark.parametrize("where", [(0.3, 2.0), (-0.2, 2.1), (0.0, 2.3)])
def test_a_lost_track_continues_near_its_prediction(tracker, gap, where):
    numbers = follow(tracker, [[seen(0.0)]] * 10)
    assert follow(tracker, [[seen(*where)]], start=9 / 30 + gap) == [numbers[-1]]


@pytest.mark.parametrize("other", [{"colour": 2}, {"label": "4"}])
def test_another_appearance_or_label_is_another_track(tracker, other):
    here, changed = {"label": "3"}, {"label": "3"} | other
    numbers = follow(tracker, [[seen(0.0, **here)]] * 5 + [[seen(0.0, **changed)]] * 5)
    assert numbers[5:] == [None] * 5


def test_camera_motion_is_compensated(tracker):
    """Without the camera's pose a quick turn of the head would look like another person."""
    names = []
    for i in range(40):
        turn = Transform((0.0, 0.0, 0.0), Rotation.from_rpy(0.0, 0.12 * i, 0.0))
        x, _, z = turn.inverse() @ (0.0, 0.0, 2.0)
        found = seen(0.0)
        located = Located(found.candidate, (x, 0.0, z), True, 0.04, found.appearance)
        tracker.update(round(i / 30 * 1e9), [located], turn)
        names += [track.number for track in tracker.tracks]
    assert set(names) == {1}


# rendered people; 200 of each: scripts/benchmark/measure identity


@pytest.mark.parametrize("seed", range(1000, 1002))
def test_another_person_does_not_take_over_a_lost_track(seed):
    assert not replaced(seed)


@pytest.mark.parametrize("seed", range(1000, 1002))
def test_a_returning_person_is_followed_again(seed):
    assert returned(seed)


@pytest.mark.parametrize("seed", range(1001, 1003))
def test_the_followed_person_is_kept_while_another_one_crosses(seed):
    assert crossed(seed)
