"""Targets of other programs and of the tutorial, and where they are."""

import math

import pytest

from head_tracking.tracking import (
    FictitiousTarget,
    FictitiousTargetParameters,
    Target,
    TargetPlacer,
)
from head_tracking.transforms import TransformBuffer

SECOND = 1_000_000_000


@pytest.fixture
def buffer(kinectbot):
    buffer = TransformBuffer()
    buffer.set_model(kinectbot)
    buffer.set_joint_positions(SECOND, {"head_pan_joint": 0.0, "head_tilt_joint": 0.0})
    buffer.set_joint_positions(2 * SECOND, {"head_pan_joint": 1.0, "head_tilt_joint": 0.0})
    return buffer


@pytest.fixture
def placer(buffer):
    return TargetPlacer(buffer, "head_pan_link", timeout=1.0)


def ahead(stamp: int, frame: str = "camera_link") -> Target:
    return Target(stamp, frame, (2.0, 0.0, 0.0))


def bearing(point) -> float:
    return math.atan2(point[1], point[0] - 0.0115)


@pytest.mark.parametrize(
    ("stamp", "pan"), [(SECOND + SECOND // 2, 0.5), (0, 1.25)], ids=["at its stamp", "no stamp"]
)
def test_a_target_is_placed_with_the_joints_of_its_stamp_or_where_the_head_was_sent(
    placer, stamp, pan
):
    placer.offer(ahead(stamp), 0.0)
    ((_, point),) = placer.place(0.0, {"head_pan_joint": 1.25, "head_tilt_joint": 0.0})
    assert bearing(point) == pytest.approx(pan)


@pytest.mark.parametrize("offered", [0.0, 500.0], ids=["too late", "before the clock jumped back"])
def test_a_target_that_cannot_be_placed_in_time_is_refused_once(placer, offered):
    placer.offer(ahead(99 * SECOND), offered)
    if offered == 0.0:
        assert placer.place(0.9, {}) == []
        assert placer.take_refusal() is None
    assert placer.place(1.1, {}) == []
    refusal = placer.take_refusal()
    assert refusal.target == ahead(99 * SECOND)
    assert "future" in refusal.reason
    assert placer.place(1.2, {}) == []
    assert placer.take_refusal() is None


def test_a_target_waits_for_the_joint_states_of_its_stamp(placer, buffer):
    placer.offer(ahead(2 * SECOND + SECOND // 2), 0.0)
    assert placer.place(0.1, {}) == []
    buffer.set_joint_positions(3 * SECOND, {"head_pan_joint": 0.0, "head_tilt_joint": 0.0})
    ((_, point),) = placer.place(0.2, {})
    assert bearing(point) == pytest.approx(0.5)
    assert placer.place(0.3, {}) == []


def test_one_that_can_be_placed_hides_one_that_is_too_late(placer):
    placer.offer(ahead(0, "gripper"), 0.0)
    placer.offer(ahead(SECOND), 2.0)
    assert len(placer.place(2.0, {})) == 1
    assert placer.place(9.0, {}) == []


def test_the_newest_that_can_be_placed_wins_and_newer_ones_wait(placer, buffer):
    for index, stamp in enumerate((2 * SECOND + 1, SECOND, 2 * SECOND, 3 * SECOND)):
        placer.offer(ahead(stamp), 0.1 * index)
    ((target, _),) = placer.place(0.4, {}, latest_only=True)
    assert target.stamp == 2 * SECOND
    assert not placer.place(0.5, {}, latest_only=True)
    buffer.set_joint_positions(3 * SECOND, {"head_pan_joint": 0.0, "head_tilt_joint": 0.0})
    ((target, _),) = placer.place(0.6, {}, latest_only=True)
    assert target.stamp == 3 * SECOND
    assert not placer.place(0.7, {}, latest_only=True)  # the one that came before is forgotten


@pytest.mark.parametrize(("rate", "timeout"), [(10, 0.0), (100, 1.0), (100, 30.0)])
def test_a_stream_that_waits_for_its_frame_is_told_why_in_time(buffer, rate, timeout):
    placer = TargetPlacer(buffer, "head_pan_link", timeout)
    told = None
    for k in range(2 * rate):
        now = 5.0 + k / rate
        placer.offer(ahead(2 * SECOND, "gripper"), now)
        assert placer.place(now, {}) == []
        if told is None and (refusal := placer.take_refusal()) is not None:
            told = now - 5.0
            assert "gripper" in refusal.reason
    assert told <= 1.05


def test_many_that_wait_for_one_frame_cost_one_lookup(placer, buffer, monkeypatch):
    asked = []
    transform_point = buffer.transform_point
    monkeypatch.setattr(
        buffer, "transform_point", lambda *given: asked.append(given) or transform_point(*given)
    )
    for k in range(30):
        placer.offer(ahead(3 * SECOND + k), 0.0)
    placer.offer(ahead(SECOND), 0.0)  # seen before: it can be placed
    assert len(placer.place(0.1, {})) == 1
    assert len(asked) == 2


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e308])
def test_a_target_that_is_nowhere_is_refused(placer, bad):
    placer.offer(Target(0, "camera_link", (1.0, bad, 0.0)), 0.0)
    assert placer.place(0.0, {}) == []
    refusal = placer.take_refusal()
    assert refusal.reason
    assert refusal.target.frame_id == "camera_link"
    assert len(str(refusal.target)) < 60


def test_the_path_is_the_tutorials():
    target = FictitiousTarget(FictitiousTargetParameters())
    for index in range(600):
        t = 0.025 * (index + 1)
        x, y, z = target.advance()
        assert x == pytest.approx(0.5 + 0.25 * math.sin(t))
        assert y == pytest.approx(0.5 * math.sin(t))
        assert z == pytest.approx(-0.1 + 0.5 * abs(math.sin(t)))


def test_a_late_message_is_farther_along_the_path():
    target, other = (FictitiousTarget(FictitiousTargetParameters()) for _ in range(2))
    for _ in range(3):
        point = target.advance()
    assert other.advance(3.0) == pytest.approx(point)


def test_a_centre_needs_three_numbers():
    with pytest.raises(ValueError, match="center"):
        FictitiousTargetParameters(center=(1.0, 2.0))


def test_the_harmonic_path_has_the_tutorials_ends_and_no_jerk():
    step = 0.025
    targets = {
        path: FictitiousTarget(FictitiousTargetParameters(path=path, step=step))
        for path in ("tutorial", "harmonic")
    }
    heights = {path: [target.advance()[2] for _ in range(600)] for path, target in targets.items()}
    for path, z in heights.items():
        assert min(z) == pytest.approx(-0.1, abs=1e-3), path
        assert max(z) == pytest.approx(0.4, abs=1e-3), path

    def hardest(z):
        """The largest acceleration [m/rad^2]."""
        bends = zip(z, z[1:], z[2:], strict=False)
        return max(abs(a - 2.0 * b + c) for a, b, c in bends) / step**2

    assert hardest(heights["harmonic"]) < 1.01  # 2 * 0.5 m, at both ends
    assert hardest(heights["tutorial"]) > 20.0
