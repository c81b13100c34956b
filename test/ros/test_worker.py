"""Work beside the executor's thread: the newest thing only, in order, and an end."""

import threading

import pytest
from rclpy.node import Node
from waiting import wait_for

from head_tracking.ros.kit import node_thread
from head_tracking.ros.kit.worker import Worker


@pytest.fixture
def make():
    workers = []

    def make(work):
        workers.append(Worker("work", work))
        return workers[-1]

    yield make
    for worker in workers:
        worker.close()
    assert "work" not in {thread.name for thread in threading.enumerate()}


def test_of_many_things_the_newest_is_worked_on(make):
    began, go, done = threading.Event(), threading.Event(), []

    def work(thing):
        began.set()
        assert go.wait(10.0)
        done.append(thing)

    worker = make(work)
    worker.offer(0)
    assert began.wait(10.0)
    for thing in range(1, 9):
        worker.offer(thing)
    worker.do(lambda: done.append("first"))
    go.set()
    wait_for(lambda: len(done) == 3)
    assert done == [0, "first", 8]


def test_what_is_done_later_keeps_its_order_also_when_the_delay_shrinks(make):
    done = []
    worker = make(done.append)
    worker.later(0.1, lambda: done.append("slow"))
    worker.later(0.0, lambda: done.append("quick"))
    worker.offer("work")
    wait_for(lambda: len(done) == 3)
    assert done == ["work", "slow", "quick"]


def test_an_error_ends_the_node_by_its_next_offer(make):
    def work(_):
        raise KeyError("broken")

    worker = make(work)

    def offered():
        try:
            worker.offer(1)
        except KeyError:
            return True
        return False

    wait_for(offered)


def test_the_rest_is_left_out_at_the_end(make):
    began, go, done = threading.Event(), threading.Event(), []
    worker = make(lambda thing: (began.set(), go.wait(10.0), done.append(thing)))
    worker.offer(1)
    assert began.wait(10.0)
    worker.offer(2)
    worker.later(0.0, lambda: done.append("later"))
    threading.Timer(0.1, go.set).start()
    worker.close()
    assert done == [1]


def test_a_thread_of_its_own_ends_at_once_however_long_nothing_comes(threads, monkeypatch):
    monkeypatch.setattr(node_thread, "_POLL", 1000.0)
    own = node_thread.NodeThread.beside(Node("person"), "waiting")
    own.start()
    for _ in range(2):
        own.close()
    assert "waiting" not in {thread.name for thread in threading.enumerate()}
