"""Work beside the executor's thread: the newest thing only, in order, and an end."""

import threading

import pytest
from waiting import wait_for

from head_tracking.ros.kit.threads import Worker


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
