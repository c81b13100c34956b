"""Lookups that somebody awaits."""

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.time import Time
from transform_messages import shifted
from waiting import wait_for

from head_tracking.tf import Buffer, TransformListener


@pytest.fixture
def buffer() -> Buffer:
    buffer = Buffer()
    buffer.set_transform(shifted(1.0, 1))
    return buffer


def test_a_future_waits_and_is_done_when_it_can_be(buffer):
    future = buffer.wait_for_transform_async("map", "ball", Time(seconds=3))
    buffer.set_transform(shifted(2.0, 2))
    assert not future.done()
    buffer.set_transform(shifted(4.0, 4))
    assert future.done()
    assert future.result().transform.translation.x == pytest.approx(3.0)


def test_a_cancelled_future_is_forgotten(buffer):
    future = buffer.wait_for_transform_async("map", "ball", Time(seconds=3))
    future.cancel()
    buffer.set_transform(shifted(4.0, 4))
    assert future.cancelled()
    assert not buffer.core._requests


def test_an_executor_awaits_while_it_works(buffer):
    """Two tasks wait in one thread, and a timer of the same executor brings what they want."""
    rclpy.init()
    node = rclpy.create_node("awaits")
    listener = TransformListener(buffer, node)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        tasks = [
            executor.create_task(buffer.lookup_transform_async, "map", "ball", Time(seconds=second))
            for second in (2, 3)
        ]
        tasks.append(
            executor.create_task(
                buffer.lookup_transform_full_async,
                *("map", Time(seconds=1), "ball", Time(seconds=3), "map"),
            )
        )
        timer = node.create_timer(0.02, lambda: buffer.set_transform(shifted(5.0, 5)))
        wait_for(
            lambda: executor.spin_once(timeout_sec=0.1) or all(task.done() for task in tasks), 30.0
        )
        assert [t.result().transform.translation.x for t in tasks] == pytest.approx([2, 3, 3])
        timer.cancel()
        listener.unregister()
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown()


def test_a_question_that_makes_no_sense_disturbs_nobody(buffer):
    for question in (("map", "ball", None), (3, "ball", Time())):
        with pytest.raises(TypeError):
            buffer.wait_for_transform_async(*question)
    future = buffer.wait_for_transform_async("map", "later", Time())
    buffer.set_transform(shifted(1.0, 1, child="later"))
    assert future.done()
