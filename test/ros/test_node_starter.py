"""node_starter: what it starts, what it answers, and that nobody waits for it."""

from collections.abc import Callable
from typing import Any

import pytest
from rclpy.node import Node
from std_srvs.srv import Trigger
from waiting import wait_for

from head_tracking.exceptions import HeadTrackingError
from head_tracking.run.node_starter import NodeStarterNode


@pytest.fixture
def ask(threads) -> Callable[[str], Any]:
    person = Node("person")
    threads.start(person)

    def ask(name: str) -> Any:
        client = person.create_client(Trigger, f"node_starter/{name}")
        wait_for(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        wait_for(future.done)
        return future.result()

    return ask


def test_what_keeps_a_node_from_starting_is_the_answer_and_others_start(threads, ask):
    def start(name: str) -> None:
        if name == "broken":
            raise HeadTrackingError("there is no camera here")

    threads.start(NodeStarterNode(start, ("broken", "point_head")))
    answer = ask("broken")
    assert (answer.success, answer.message) == (False, "there is no camera here")
    assert ask("point_head").success
