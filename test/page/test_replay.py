"""Recordings that browsers replay."""

from types import SimpleNamespace

import pytest

from head_tracking.page.replay import Replays
from head_tracking.recording.recording import LastMinute, Observation, RecordingError


def test_the_recording_that_nobody_uses_is_closed_first(kinectbot):
    robot = SimpleNamespace(model=lambda: kinectbot, head_of=lambda _: (None, ""))
    last_minute = LastMinute(60.0)
    last_minute.add(Observation(1))
    replays = Replays(robot, last_minute, lambda _: None)  # type: ignore[arg-type]
    used, unused = (replays.open()["key"] for _ in range(2))
    for _ in range(10):
        replays.open()
        assert replays.at(used, 0.0)
    with pytest.raises(RecordingError):
        replays.at(unused, 0.0)
