import gzip
import json
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.transforms import Rotation, Transform
from head_tracking.viewer.observation import Observation
from head_tracking.viewer.recording import Recorder, Recording, RecordingError

SECOND = 1_000_000_000


def seen(seconds: float, pan: float = 0.0) -> Observation:
    return Observation(
        round(seconds * SECOND),
        {"head_pan_joint": pan},
        {"gripper": Transform((0.1, 0.2, 0.3), Rotation.from_rpy(0.1, 0.2, 0.3))},
        (1.0, 2.0, 3.0),
        "(1, 2, 3) in base_link",
        0.01,
        "tracking",
    )


def test_only_the_last_minute_is_kept():
    recorder = Recorder(60.0)
    for second in range(200):
        recorder.add(seen(second))
    recording = recorder.recording()
    assert recording.duration == pytest.approx(60.0)
    assert recording.seen[-1].stamp == 199 * SECOND


def test_a_jump_back_in_time_starts_anew():
    recorder = Recorder(60.0)
    recorder.add(seen(100))
    recorder.add(seen(5))
    assert [one.stamp for one in recorder.recording().seen] == [5 * SECOND]


def test_nothing_seen_is_no_recording():
    with pytest.raises(RecordingError, match="nothing"):
        Recorder(60.0).recording()


def test_what_is_written_is_read_again():
    recording = Recording((seen(1.0, 0.1), seen(2.0, 0.2), Observation(3 * SECOND)))
    again = Recording.from_bytes(recording.to_bytes())
    assert again.seen[0].joints == recording.seen[0].joints
    assert again.seen[0].target == (1.0, 2.0, 3.0)
    assert again.seen[0].frames["gripper"] == pytest.approx(recording.seen[0].frames["gripper"])
    assert again.seen[2] == recording.seen[2]


def test_scrubbing_shows_what_was_seen_last_before():
    recording = Recording((seen(10.0, 0.1), seen(11.0, 0.2), seen(12.0, 0.3)))
    pans = [recording.at(time).joints["head_pan_joint"] for time in (-1, 0, 0.99, 1, 1.5, 9)]
    assert pans == [0.1, 0.1, 0.1, 0.2, 0.2, 0.3]


@given(st.binary(max_size=400))
def test_any_other_file_is_refused_with_a_reason(data):
    with pytest.raises(RecordingError, match="recording"):
        Recording.from_bytes(data)


@pytest.mark.parametrize(
    "damage",
    [
        lambda d: d["seen"][0].pop("joints"),
        lambda d: d["seen"][0].update(target=[1, 2]),
        lambda d: d["seen"][0].update(joints={"a": "b"}),
        lambda d: d["seen"][0].update(frames={"a": [0, 0, 0, 0, 0, 0, 0]}),
        lambda d: d["seen"][0]["joints"].update(a=float("nan")),
        lambda d: d.update(seen=[]),
        lambda d: d.update(seen=3),
        lambda d: d.update(format="another"),
        lambda d: d["seen"].append({**d["seen"][0], "stamp": 0}),
    ],
)
def test_a_damaged_recording_is_refused_with_a_reason(damage):
    document = json.loads(gzip.decompress(Recording((seen(1.0), seen(2.0))).to_bytes()))
    damage(document)
    with pytest.raises(RecordingError):
        Recording.from_bytes(gzip.compress(json.dumps(document).encode()))


def test_a_file_that_was_cut_off_is_refused():
    data = Recording(tuple(seen(t) for t in range(50))).to_bytes()
    with pytest.raises(RecordingError):
        Recording.from_bytes(data[: len(data) // 2])


def test_a_file_of_nests_is_no_recording_and_ends_nothing():
    with pytest.raises(RecordingError):
        Recording.from_bytes(gzip.compress(b"[" * 100_000 + b"]" * 100_000))


def test_what_is_kept_is_taken_while_more_comes():
    """In another thread, as a person who saves the last minute does."""
    recorder = Recorder(60.0)
    recorder.add(Observation(0))
    ended = threading.Event()

    def go_on() -> None:
        stamp = 0
        while not ended.is_set():
            stamp += 100_000
            recorder.add(Observation(stamp))

    thread = threading.Thread(target=go_on)
    thread.start()
    try:
        for _ in range(300):
            recorder.recording()
    finally:
        ended.set()
        thread.join()
