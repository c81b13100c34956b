"""A camera on the head whose stamps are wrong: how wrong is found, and the head follows."""

import math
from dataclasses import replace

import numpy as np
import pytest
import runs
from closed_loop import ClosedLoop
from plant import PlainServo
from runs import HEAD, around, circle, from_rest, run, sine, still, swing, tracker

from head_tracking.tracking import LAWS, HeadBase, LearningParameters, TargetState, Tracker

ON_HEAD = replace(runs.ON_HEAD, duration=8.0)
SMALL = {"delay": 0.6, "duration": 4.0, "servos": PlainServo(), "start": (0.0, 0.0314), "seed": 9}


class Watched(runs.Watched):
    """A tracker; the errors that it has applied are kept."""

    def __init__(self, base=None):
        self.applied, self.learned = [0.0], []
        tracker = Tracker(HEAD, LAWS["predictive"](HEAD, 0.02), base=base)
        super().__init__(tracker, self.note)

    def note(self, now, steered):
        self.applied.append(steered.camera.applied)
        self.learned.append(steered.camera.learned)


def watch(path, conditions):
    watched = Watched()
    return watched, run(path, conditions, watched).recording


@pytest.mark.parametrize(
    ("path", "late", "changes", "most"),
    [
        (still, -0.15, {"duration": 5.0, "seed": 7}, 0.015),
        (swing, 0.4, {"duration": 5.0, "seed": 7}, 0.015),
        (circle, 0.2, {"duration": 5.0, "seed": 7}, 0.015),
        # a small motion, which shows the error slowly
        (lambda t: around(0.019, 0.1), 0.6, SMALL, 0.02),
        (from_rest(1.0), 0.2, {"duration": 6.0, "servos": PlainServo()}, 0.02),  # a fast swing
        # only pan turns: that excludes the mountings with pan reversed, but not the one of tilt
        (
            from_rest(0.5),
            0.05,
            {"duration": 9.0, "stamp_jitter": 0.0115, "start": (0.01, 0.04151)}
            | {"servos": PlainServo(), "field": ON_HEAD.field, "seed": 2},
            0.02,
        ),
    ],
)
def test_the_error_is_found(path, late, changes, most):
    conditions = replace(ON_HEAD, **({"stamp_error": late, "field": (3.0, 3.0)} | changes))
    watched, _ = watch(path, conditions)
    assert watched.applied[-1] == pytest.approx(late, abs=most)
    known = [each for each in watched.learned if each.source == "learned"]
    assert all(abs(each.value - late) < 4.0 * each.deviation for each in known)


@pytest.mark.parametrize(
    ("before", "late", "pause"), [(0.5, 0.1, 2.0), (0.1, 0.5, 2.0), (0.8, 0.15, 0.5)]
)
def test_the_error_of_a_camera_that_has_restarted_is_found_again(before, late, pause):
    view = replace(ON_HEAD, field=(1.5, 1.1), stamp_jitter=0.01)
    again = replace(view, delay=late, stamp_error=late, gaps=((0.0, 5.0 + pause),))
    first = replace(view, delay=before, stamp_error=before, gaps=((5.0, 99.0),), seed=6)
    watched, _ = watch(circle, replace(first, duration=10.0 + pause + late, more=(again,)))
    assert watched.applied[250] == pytest.approx(before, abs=0.02)
    assert watched.applied[-1] == pytest.approx(late, abs=0.02)


@pytest.mark.parametrize(
    ("bearing", "late", "points"), [(0.3, 0.15, 30.0), (0.8, 0.45, 30.0), (0.7, 0.45, 15.0)]
)
def test_a_still_face_that_is_seen_late_is_not_overshot(bearing, late, points):
    """Its points move with the head at first; no speed of its own explains that."""
    conditions = replace(
        ON_HEAD, duration=4.0, delay=late, stamp_error=late, field=(2.2, 1.5), points=points
    )
    _, recording = watch(lambda _: around(bearing), conditions)
    off = recording.positions[:, 0] - recording.wanted[0, 0]
    assert math.degrees(off.max()) < 1.0
    settled = recording.times - recording.times[0] > late + 1.0
    assert math.degrees(np.abs(off[settled]).max()) < 1.0


def test_a_delay_that_is_given_is_right_from_the_first_point_on():
    late = 0.25
    conditions = replace(ON_HEAD, delay=0.25, field=(3.0, 3.0), duration=4.0)
    watched = Watched()
    watched.tracker.learn(LearningParameters(camera_delay=late))
    false = replace(conditions, stamp_error=late)
    right, given = (
        run(swing, each, steered).recording.rms
        for each, steered in ((conditions, Watched()), (false, watched))
    )
    assert set(watched.applied[1:]) == {late}
    assert given < 1.2 * right


def test_a_correction_beyond_the_timeout_does_not_end_tracking():
    conditions = replace(ON_HEAD, duration=12.0, stamp_error=0.7, field=(3.0, 3.0))
    watched, recording = watch(swing, conditions)
    assert watched.applied[-1] == pytest.approx(0.7, abs=0.05)
    assert recording.between(6.0).rms < 0.2


FAST = {"delay": 0.0, "noise": 0.0, "duration": 8.0, "start": (0.012, 0.04151)}
"""A fast swing that an error would make smaller."""


def servo(dead_time, lag):
    return PlainServo(dead_time=dead_time, lag=lag, speed=5.0, acceleration=40.0, profile=40.0)


@pytest.mark.parametrize(
    ("path", "changes"),
    [
        (swing, {"points": 8.0, "delay": 0.4, "field": (3.0, 3.0), "seed": 3}),
        (sine(1.0, 0.3), {"field": (3.0, 3.0), "seed": 3}),
        (from_rest(1.0), FAST | {"servos": servo(0.04, 0.04)}),
        (from_rest(1.0), FAST | {"servos": servo(0.08, 0.012)}),
    ],
)
def test_no_error_is_believed_where_there_is_none(path, changes):
    watched, _ = watch(path, replace(ON_HEAD, **({"duration": 12.0} | changes)))
    assert not any(watched.applied)


def test_wrong_stamps_that_jitter_cost_little():
    jitter = replace(ON_HEAD, duration=10.0, stamp_jitter=0.0115, seed=2)
    usual, wrong = (
        watch(circle, replace(jitter, stamp_error=error))[1].between(6.0).rms
        for error in (0.0, 0.09)
    )
    assert wrong < 1.5 * usual + 0.005


def test_one_point_from_the_future_keeps_nobody_from_learning():
    watched = Watched()
    watched.target_seen(1_060.0, around(0.0), 1_000.0)
    run(swing, replace(ON_HEAD, stamp_error=0.07), watched)
    assert watched.applied[-1] == pytest.approx(0.07, abs=0.015)


def test_points_from_the_future_do_not_pile_up():
    steered = tracker()
    for k in range(3000):
        now = 1_000.0 + 0.02 * k
        steered.joints_read(now, (0.0, 0.0))
        steered.target_seen(now + 100.0, around(0.1), now, moving=True)
        steered.step(now)
    assert len(steered.camera.waiting) < 100


def test_nothing_of_before_a_recentring_comes_back_with_a_found_error():
    watched = Watched()
    step, seen = watched.step, watched.target_seen
    asked = []

    def recentring(now):
        if now - 1_000.0 > 0.8 and not asked:
            asked.append(now)
            watched.tracker.recenter()
        return step(now)

    def before(*args, **moving):
        return None if asked else seen(*args, **moving)

    watched.step, watched.target_seen = recentring, before
    conditions = replace(ON_HEAD, stamp_error=0.12, duration=6.0)
    positions = run(still, conditions, watched).recording.positions
    assert watched.tracker.state is TargetState.IDLE
    assert np.abs(positions[-1]).max() < 0.05


def test_the_error_is_found_while_the_base_turns():
    def sway(t):
        return 0.0, 0.0, 0.4 * math.sin(math.tau * 0.25 * t)

    conditions = replace(ON_HEAD, base=sway, field=(3.0, 3.0), stamp_error=-0.09)
    loop = ClosedLoop(swing, conditions)
    watched = Watched(HeadBase(loop.buffer, "odom", HEAD.base_frame))
    recording = loop.run(watched).recording
    assert watched.applied[-1] == pytest.approx(-0.09, abs=0.015)
    assert recording.between(4.0).rms < 0.03
