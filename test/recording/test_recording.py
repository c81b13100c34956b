import itertools

import pytest
from waiting import repeating

from head_tracking.recording.recording import LastMinute, Observation, Recording

SECOND = 1_000_000_000


def seen(seconds: float, pan: float = 0.0) -> Observation:
    return Observation(round(seconds * SECOND), {"head_pan_joint": pan})


def test_only_the_last_minute_is_kept():
    last_minute = LastMinute(60.0)
    for second in range(200):
        last_minute.add(seen(second))
    recording = last_minute.recording()
    assert recording.duration == pytest.approx(60.0)
    assert recording.seen[-1].stamp == 199 * SECOND


def test_pictures_of_the_last_minute_are_kept_five_a_second():
    last_minute = LastMinute(60.0)
    last_minute.add_picture(b"before the first observation")
    for moment in range(2000):
        last_minute.add(seen(moment / 20))
        last_minute.add_picture(b"%d" % moment)
    recording = last_minute.recording()
    stamps = [one.stamp for one in recording.pictures]
    assert len(stamps) == pytest.approx(300, abs=2)
    assert recording.seen[-1].stamp - stamps[0] <= 60 * SECOND
    picture = recording.picture_at(recording.duration)
    assert picture is not None
    assert int(picture.data) == pytest.approx(1999, abs=4)
    last_minute.add(seen(1.0))
    assert last_minute.recording().pictures == ()


def test_a_jump_back_in_time_starts_anew():
    last_minute = LastMinute(60.0)
    last_minute.add(seen(100))
    last_minute.add(seen(5))
    assert [one.stamp for one in last_minute.recording().seen] == [5 * SECOND]


def test_scrubbing_shows_what_was_seen_last_before():
    recording = Recording((seen(10.0, 0.1), seen(11.0, 0.2), seen(12.0, 0.3)))
    pans = [recording.at(time).joints["head_pan_joint"] for time in (-1, 0, 0.99, 1, 1.5, 9)]
    assert pans == [0.1, 0.1, 0.1, 0.2, 0.2, 0.3]


def test_what_is_kept_is_taken_while_more_comes():
    """In another thread, as a person who saves the last minute does."""
    last_minute = LastMinute(60.0)
    last_minute.add(Observation(0))
    stamps = itertools.count(100_000, 100_000)
    with repeating(lambda: last_minute.add(Observation(next(stamps)))):
        for _ in range(300):
            last_minute.recording()
