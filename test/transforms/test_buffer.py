import math
import threading
from queue import SimpleQueue

import numpy as np
import pytest
from waiting import join, repeating

from head_tracking.transforms import (
    InvalidArgumentException,
    LookupException,
    Rotation,
    Transform,
    TransformBuffer,
)
from head_tracking.transforms import buffer as buffers
from head_tracking.transforms.history import JointHistory

SECOND = 1_000_000_000

HEAD = {"head_pan_joint": 0.5, "head_tilt_joint": -0.2}


@pytest.fixture
def buffer(kinectbot):
    buffer = TransformBuffer()
    buffer.set_model(kinectbot)
    buffer.set_joint_positions(SECOND, HEAD)
    return buffer


def moved(x: float) -> Transform:
    return Transform.from_xyz_rpy((x, 0, 0))


def test_the_answer_carries_frames_and_the_latest_common_time(buffer):
    buffer.set_joint_positions(3 * SECOND, {"head_pan_joint": 0.6})
    found = buffer.lookup_transform("base_link", "camera_link")
    assert (found.target_frame, found.source_frame) == ("base_link", "camera_link")
    assert found.stamp == SECOND  # the tilt joint was not heard of since
    assert buffer.lookup_transform("base_link", "pan_tilt_bracket").stamp == 3 * SECOND
    assert buffer.lookup_transform("base_link", "torso_link").stamp == 0


def test_the_model_keeps_its_frames_from_being_overwritten(buffer):
    before = buffer.lookup_transform("base_link", "camera_link")
    assert not buffer.set_transform(SECOND, "torso_link", "head_pan_link", moved(5))
    with pytest.raises(InvalidArgumentException):
        buffer.set_transform(SECOND, "odom", "head_pan_link", moved(5))
    assert buffer.lookup_transform("base_link", "camera_link") == before


def test_the_root_of_the_model_is_not_put_below_its_own_links(buffer):
    """Parent and child exchanged would be a loop that nothing ends."""
    with pytest.raises(InvalidArgumentException, match="exchange"):
        buffer.set_transform(SECOND, "camera_link", "base_link", moved(5))
    assert buffer.set_transform(SECOND, "odom", "base_link", moved(5))
    assert buffer.can_transform("odom", "camera_link")


@pytest.mark.parametrize("static", [False, True])
def test_the_root_of_the_model_is_not_put_into_or_below_a_loop(kinectbot, static):
    """Every lookup along the root would fail, also of the frames of the head."""
    loops = (
        [("odom", "base_link"), ("base_link", "odom")],
        [("map", "base_link"), ("camera_link", "map")],
        [("odom", "base_link"), ("map", "odom"), ("odom", "map")],
        [("cup", "table"), ("table", "cup"), ("cup", "base_link")],
    )
    for *accepted, last in loops:
        for before in (True, False):
            buffer = TransformBuffer()
            if before:
                buffer.set_model(kinectbot)
            for parent, child in accepted:
                buffer.set_transform(SECOND, parent, child, moved(1), static=static)
            if before:
                with pytest.raises(InvalidArgumentException, match="loop"):
                    buffer.set_transform(SECOND, *last, moved(1), static=static)
            else:
                buffer.set_transform(SECOND, *last, moved(1), static=static)
                buffer.set_model(kinectbot)
            buffer.set_joint_positions(SECOND, HEAD)
            assert buffer.can_transform("torso_link", "base_link")
            assert buffer.can_transform("camera_link", "base_link")


def test_frames_that_joints_move_are_found_also_after_they_were_attached_elsewhere(buffer):
    def carried():
        names = ("base_link", "camera_link", "nowhere", "tool", "ball")
        return {name for name in names if buffer.is_moved_by(name, tuple(HEAD))}

    buffer.set_transform(SECOND, "base_link", "tool", moved(1.0), static=True)
    buffer.set_transform(SECOND, "tool", "ball", moved(1.0))
    assert carried() == {"camera_link"}
    buffer.set_transform(SECOND, "camera_link", "tool", moved(1.0), static=True)
    assert carried() == {"camera_link", "tool", "ball"}
    buffer.set_transform(2 * SECOND, "base_link", "ball", moved(1.0))
    assert carried() == {"camera_link", "tool"}


def test_a_new_model_replaces_the_old_one(buffer, turtlebot):
    buffer.set_model(turtlebot)
    assert "hair_link" not in buffer.frames()
    with pytest.raises(LookupException):
        buffer.lookup_transform("base_link", "hair_link")
    # the head's joints have the same names: their history is still good
    assert buffer.can_transform("base_link", "camera_link", SECOND)
    assert not buffer.can_transform("base_link", "left_wheel_link")


def test_a_new_model_stays_where_the_old_one_was_put(buffer, kinectbot, turtlebot):
    """A static transform is published once: nobody would send it again."""
    buffer.set_transform(0, "world", "base_link", moved(7), static=True)
    for model in (kinectbot, turtlebot):
        buffer.set_model(model)
        assert buffer.lookup_transform("world", "base_link").transform == moved(7)


def test_a_joint_without_a_position_is_named(kinectbot):
    buffer = TransformBuffer()
    buffer.set_model(kinectbot)
    with pytest.raises(LookupException):
        buffer.lookup_transform("head_tilt_link", "camera_link")


def test_bad_samples_are_refused_and_the_good_joints_beside_them_taken(buffer):
    before = buffer.lookup_transform("base_link", "camera_link")
    with pytest.raises(InvalidArgumentException):
        buffer.set_joint_positions(2 * SECOND, {"head_pan_joint": 1.0, "head_tilt_joint": math.nan})
    assert buffer.lookup_transform("base_link", "camera_link") == before
    assert buffer.latest_joint_position("head_pan_joint") == (2 * SECOND, 1.0)


def test_clear_forgets_what_was_recorded(buffer):
    buffer.set_transform(0, "world", "base_link", moved(7), static=True)
    buffer.set_transform(SECOND, "world", "ball", moved(7))
    buffer.clear()
    assert not buffer.can_transform("base_link", "camera_link")
    assert not buffer.can_transform("world", "ball")
    assert buffer.can_transform("world", "torso_link")


def test_readers_see_one_moment_while_a_writer_writes(kinectbot):
    """Pan and tilt are always written equal: a lookup that mixes two moments would show."""
    buffer = TransformBuffer()
    buffer.set_model(kinectbot)
    buffer.set_joint_positions(1, dict.fromkeys(HEAD, 0.0))
    mixed = []

    def read():
        found = buffer.lookup_transform("head_pan_link", "camera_link").transform
        _, tilt, pan = found.rotation.as_rpy()
        if abs(tilt - pan) > 1e-9:
            mixed.append(tilt - pan)

    with repeating(read, read, read):
        for step in range(2, 3000):
            angle = 1e-3 * (step % 1000)
            buffer.set_joint_positions(step, dict.fromkeys(HEAD, angle))
    assert not mixed


@pytest.mark.parametrize("number", [np.float32, np.float64, int])
def test_numbers_of_other_types_become_floats(buffer, number):
    """A message cannot hold them: what reaches the wire would be garbage."""
    zero, one = number(0), number(1)
    turn = Rotation(zero, zero, zero, one)
    buffer.set_transform(SECOND, "map", "base_link", Transform((one, zero, zero), turn))
    buffer.set_transform(0, "cup", "tea", Transform((one, zero, zero), turn), static=True)
    buffer.set_joint_positions(2 * SECOND, {"head_pan_joint": one, "head_tilt_joint": zero})
    answers = [
        *buffer.lookup_transform("map", "base_link", SECOND).transform,
        *buffer.lookup_transform("cup", "tea").transform,
        *buffer.lookup_transform("base_link", "camera_link").transform,
        *buffer.transform_point((one, zero, zero), "cup", "tea"),
    ]
    assert {type(answer) for answer in answers} == {float}


def test_until_a_joint_is_measured_samples_tell_where_its_link_is(kinectbot):
    buffer = TransformBuffer()
    buffer.set_model(kinectbot)
    joint = kinectbot.joints["head_pan_joint"]

    def pan():
        found = buffer.lookup_transform(joint.parent, joint.child).transform
        return (joint.origin.inverse() @ found).rotation.as_rpy()[2]

    assert buffer.set_transform(SECOND, joint.parent, joint.child, joint.transform(0.3))
    assert buffer.set_transform(2 * SECOND, joint.parent, joint.child, joint.transform(0.4))
    assert pan() == pytest.approx(0.4)
    buffer.set_joint_positions(3 * SECOND, {"head_pan_joint": -0.2})
    assert pan() == pytest.approx(-0.2)
    assert not buffer.set_transform(4 * SECOND, joint.parent, joint.child, joint.transform(0.5))
    assert pan() == pytest.approx(-0.2)
    fixed = next(joint for joint in kinectbot.joints.values() if not joint.moves)
    assert not buffer.set_transform(SECOND, fixed.parent, fixed.child, Transform.identity())


def test_frames_that_are_silent_for_ten_cache_times_are_forgotten(buffer, monkeypatch):
    def hear(second, parent, child, stamp=SECOND):
        now = 1000 * SECOND + second * SECOND
        monkeypatch.setattr("head_tracking.transforms.buffer.monotonic_ns", lambda: now)
        buffer.set_transform(stamp, parent, child, Transform.identity())

    for person in range(500):
        hear(0, "map", f"person_{person}")
    buffer.set_transform(0, "map", "base_link", Transform.identity(), static=True)
    hear(99, "map", "person_500")
    assert "person_0" in buffer.frames()
    hear(111, "room", "person_501")
    people = {name for name in buffer.frames() if name.startswith("person")}
    assert people == {"person_500", "person_501"}
    assert buffer.can_transform("map", "camera_link")
    hear(112, "map", "person_0", 2 * SECOND)
    assert buffer.lookup_transform("map", "person_0").stamp == 2 * SECOND


def test_a_clock_that_is_far_ahead_costs_no_frames_of_others(buffer):
    buffer.set_transform(SECOND, "odom", "drive", Transform.identity())
    buffer.set_transform(1000 * SECOND, "map", "person", Transform.identity())
    assert buffer.can_transform("odom", "drive", SECOND)


def test_all_pairs_of_many_frames_can_be_asked_for():
    buffer = TransformBuffer()
    names = [f"frame_{index}" for index in range(40)]  # 1600 routes; 1000 are kept
    for index, name in enumerate(names):
        buffer.set_transform(0, "map", name, Transform.from_xyz_rpy((index, 0, 0)), static=True)
    for _ in range(2):
        for a, target in enumerate(names):
            for b, source in enumerate(names):
                x, *_ = buffer.lookup_transform(target, source).transform
                assert x == pytest.approx(b - a)


def test_joint_states_of_a_clock_at_rest_take_no_memory():
    history = JointHistory()
    for index in range(100):
        history.insert(0, float(index))
    assert history.at(0) == 99.0
    assert len(history.stamps) == len(history.values) == 1


def test_what_is_older_than_the_cache_takes_no_memory():
    history = JointHistory()
    for index in range(5000):
        history.insert(index * SECOND // 100, float(index))
    assert len(history) == 1002  # 10 s, and one sample more
    assert len(history.stamps) == len(history.values) <= 2 * len(history)


@pytest.mark.parametrize("stamp", [1.5, math.nan, None, "now"])
def test_a_time_that_is_no_integer_is_refused_and_recorded_nowhere(buffer, stamp):
    buffer.set_transform(SECOND, "map", "ball", moved(1.0))
    for call in (
        lambda: buffer.set_joint_positions(stamp, HEAD),
        lambda: buffer.set_joint_positions(stamp, {"another_joint": 0.0}),
        lambda: buffer.set_transform(stamp, "map", "ball", moved(1.0)),
        lambda: buffer.set_transform(stamp, "map", "cup", moved(1.0)),
        lambda: buffer.lookup_transform("base_link", "camera_link", stamp),
        lambda: buffer.can_transform("base_link", "camera_link", stamp),
    ):
        with pytest.raises(TypeError, match="nanoseconds"):
            call()
    buffer.set_transform(2 * SECOND, "map", "cup", moved(1.0))
    assert buffer.lookup_transform("map", "cup").stamp == 2 * SECOND
    buffer.set_joint_positions(2 * SECOND, HEAD)
    assert buffer.lookup_transform("base_link", "camera_link").stamp == 2 * SECOND


def test_numbers_of_numpy_are_times_and_waits(buffer):
    buffer.set_transform(np.int64(SECOND), "map", "ball", moved(1.0))
    found = buffer.lookup_transform("map", "ball", np.int64(SECOND), np.float32(0.1))
    assert type(found.stamp) is int
    assert not buffer.can_transform("map", "nowhere", SECOND, np.float32(0.01))


@pytest.mark.parametrize("cache_time", [-1, 10.0, None])
def test_a_cache_time_is_an_integer_of_at_least_0_ns(cache_time):
    with pytest.raises((TypeError, ValueError), match="time"):
        TransformBuffer(cache_time)


def test_a_matrix_is_no_transform_and_a_file_no_model(buffer):
    with pytest.raises(TypeError, match="from_matrix"):
        buffer.set_transform(SECOND, "map", "ball", np.eye(4))
    with pytest.raises(TypeError, match="load_robot_model"):
        buffer.set_model("urdf/kinectbot.urdf.xacro")
    assert buffer.can_transform("base_link", "camera_link")


def test_the_tree_has_a_line_for_each_frame_with_joints_rates_and_ages(kinectbot):
    buffer = TransformBuffer()
    buffer.set_model(kinectbot)
    for index in range(11):
        buffer.set_joint_positions(10 * SECOND + index * SECOND // 10, {"head_pan_joint": 0.0})
    buffer.set_transform(SECOND, "map", "ball", Transform.identity())
    lines = buffer.tree_as_string(now=11 * SECOND + SECOND // 2).splitlines()
    assert lines[:2] == ["base_link", "└── torso_link"]
    assert "pan_tilt_bracket  [head_pan_joint] 11.0 Hz, 0.500 s" in lines[3]
    assert any(line.endswith("[head_tilt_joint] no samples") for line in lines)
    assert any(line.endswith("├── hair_link") for line in lines)
    assert lines[-2] == "map"
    assert len(lines) == 16
    assert "0.500" not in buffer.tree_as_string()


# Waiting for what is not known yet, from other threads


def test_a_wait_may_be_without_end(buffer):
    sample = SECOND, "map", "base", Transform.identity()
    timer = threading.Timer(0.05, buffer.set_transform, sample)
    timer.start()
    assert buffer.can_transform("map", "base", timeout=math.inf)
    join(timer)


def test_an_interrupted_wait_leaves_nothing_behind(buffer, monkeypatch):
    class Interrupted(SimpleQueue):
        def get(self, *_, **__):
            raise KeyboardInterrupt

    asked = []
    monkeypatch.setattr(buffer, "can_transform", lambda *frames: asked.append(frames))
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(buffers, "SimpleQueue", Interrupted)
        buffer.lookup_transform("map", "base", timeout=1.0)
    asked.clear()
    buffer.set_transform(SECOND, "map", "base", Transform.identity())
    assert asked == []


def test_a_frame_that_is_no_name_is_refused_and_disturbs_nobody(buffer):
    with pytest.raises(TypeError):
        buffer.when(lambda: buffer.can_transform(3, "base"), lambda: None)
    with pytest.raises(TypeError):
        buffer.lookup_transform("map", 3, timeout=0.01)
    with pytest.raises(TypeError):
        buffer.lookup_transform(3, 3)
    buffer.set_transform(SECOND, "map", "base", Transform.identity())
    assert buffer.lookup_transform("map", "base").stamp == SECOND
