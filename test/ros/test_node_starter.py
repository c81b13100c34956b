"""node_starter: what it starts, what it answers, and that nobody waits for it."""

import threading
import time
from collections.abc import Callable
from typing import Any

import pytest
from contract_nodes import ControllerStandIn
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger
from waiting import wait_for

from head_tracking.control import ControlLoop
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


def test_a_controller_that_is_started_is_switched_on_and_others_just_run(threads, ask):
    made: dict[str, Any] = {}

    def start(name: str) -> None:
        if name not in made:
            made[name] = Node(name) if name == "camera" else ControllerStandIn(name, on=False)
            threads.start(made[name])

    threads.start(NodeStarterNode(start, ("point_head", "camera"), ControlLoop(None)))
    answer = ask("point_head")
    assert answer.success
    assert answer.message == "point_head runs and is switched on"
    assert made["point_head"].asked == [True]
    answer = ask("camera")
    assert answer.success
    assert answer.message == "camera runs"


def test_what_keeps_a_node_from_doing_its_work_is_the_answer(threads, ask):
    def start(name: str) -> None:
        if name == "broken":
            raise HeadTrackingError("there is no camera here")
        node = Node(name)

        def refuse(_: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
            response.message = "there is no model of the robot yet"
            return response

        node.create_service(SetBool, "~/enable", refuse)
        threads.start(node)

    threads.start(NodeStarterNode(start, ("broken", "point_head"), ControlLoop(None)))
    answer = ask("broken")
    assert (answer.success, answer.message) == (False, "there is no camera here")
    answer = ask("point_head")
    assert not answer.success
    assert "is not switched on: there is no model" in answer.message


def test_a_node_whose_start_was_asked_for_before_a_stop_is_not_switched_on(threads, ask):
    made = []
    loop = ControlLoop(None)

    def start(name: str) -> None:
        made.append(ControllerStandIn(name, on=False))
        threads.start(made[0])
        loop.owners.stop(dict)
        loop.owners.resume(loop.owners.epoch.value)

    threads.start(NodeStarterNode(start, ("point_head",), loop))
    answer = ask("point_head")
    assert (answer.success, made[0].asked) == (False, [])
    assert answer.message == "point_head runs, and the head was stopped meanwhile"


def test_starting_a_node_keeps_no_callback_of_the_process_waiting(threads, ask):
    starting, go_on = threading.Event(), threading.Event()

    def start(_: str) -> None:
        starting.set()
        go_on.wait(30.0)
        threads.start(Node("camera"))

    starter = NodeStarterNode(start, ("camera",), ControlLoop(None))
    beats: list[float] = []
    starter.create_timer(0.01, lambda: beats.append(time.monotonic()))
    threads.start(starter)
    asking = threading.Thread(target=ask, args=("camera",))
    asking.start()
    try:
        assert starting.wait(10.0)
        before = len(beats)
        wait_for(lambda: len(beats) > before + 10)  # the node's own executor goes on
    finally:
        go_on.set()
        asking.join()
