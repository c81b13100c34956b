"""Waiting for what is not known yet, from other threads."""

import math
import threading
from queue import SimpleQueue

import pytest
from waiting import join

from head_tracking.transforms import (
    ExtrapolationException,
    LookupException,
    Transform,
    TransformBuffer,
)
from head_tracking.transforms import buffer as buffers

SECOND = 1_000_000_000
STILL = Transform.identity()


@pytest.fixture
def buffer():
    return TransformBuffer()


def later(work, *arguments) -> threading.Timer:
    timer = threading.Timer(0.05, work, arguments)
    timer.start()
    return timer


def test_a_wait_may_be_without_end(buffer):
    timer = later(buffer.set_transform, SECOND, "map", "base", STILL)
    assert buffer.can_transform("map", "base", timeout=math.inf)
    join(timer)


def test_an_interrupted_wait_leaves_nothing_behind(buffer, monkeypatch):
    class Interrupted(SimpleQueue):
        def get(self, *_, **__):
            raise KeyboardInterrupt

    asked: list[str] = []
    monkeypatch.setattr(buffer, "can_transform", lambda *frames: asked.append(frames))
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(buffers, "SimpleQueue", Interrupted)
        buffer.lookup_transform("map", "base", timeout=1.0)
    asked.clear()
    buffer.set_transform(SECOND, "map", "base", STILL)
    assert asked == []


def test_a_lookup_in_vain_ends_with_the_error_that_says_why(buffer):
    with pytest.raises(LookupException):
        buffer.lookup_transform("map", "base", timeout=0.01)
    buffer.set_transform(SECOND, "map", "base", STILL)
    with pytest.raises(ExtrapolationException):
        buffer.lookup_transform("map", "base", 2 * SECOND, timeout=0.01)


def test_many_threads_wait_for_different_times(buffer):
    buffer.set_transform(0, "map", "base", STILL)
    found: list[int] = []

    def wait(stamp: int) -> None:
        found.append(buffer.lookup_transform("map", "base", stamp, timeout=30.0).stamp)

    threads = [
        threading.Thread(target=wait, args=(index * SECOND // 10,)) for index in range(1, 30)
    ]
    for thread in threads:
        thread.start()
    for index in range(1, 31):
        buffer.set_transform(index * SECOND // 10, "map", "base", STILL)
    join(*threads)
    assert sorted(found) == [index * SECOND // 10 for index in range(1, 30)]


def test_a_frame_that_is_no_name_is_refused_and_disturbs_nobody(buffer):
    with pytest.raises(TypeError):
        buffer.when(lambda: buffer.can_transform(3, "base"), lambda: None)
    with pytest.raises(TypeError):
        buffer.lookup_transform("map", 3, timeout=0.01)
    with pytest.raises(TypeError):
        buffer.lookup_transform(3, 3)
    buffer.set_transform(SECOND, "map", "base", STILL)
    assert buffer.lookup_transform("map", "base").stamp == SECOND
