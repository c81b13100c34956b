from head_tracking.recording.recording import Observation, Recording

SECOND = 1_000_000_000


def seen(seconds: float, pan: float = 0.0) -> Observation:
    return Observation(round(seconds * SECOND), {"head_pan_joint": pan})


def test_scrubbing_shows_what_was_seen_last_before():
    recording = Recording((seen(10.0, 0.1), seen(11.0, 0.2), seen(12.0, 0.3)), None)
    pans = [recording.at(time).joints["head_pan_joint"] for time in (-1, 0, 0.99, 1, 1.5, 9)]
    assert pans == [0.1, 0.1, 0.1, 0.2, 0.2, 0.3]
