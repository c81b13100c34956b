"""Services that no other callback of their node delays."""

import threading

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger
from waiting import repeating, wait_for

from head_tracking.ros.kit.threads import UrgentServices


@pytest.fixture
def client():
    """A node that is spun."""
    rclpy.init()
    node, executor = Node("client"), SingleThreadedExecutor()
    executor.add_node(node)
    with repeating(lambda: executor.spin_once(timeout_sec=0.05)):
        yield node
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()


@pytest.fixture
def node(client):
    """A node that nobody spins, with a remap rule of its own."""
    node = Node("bus", cli_args=["--ros-args", "-r", "bus:stop:=halt"])
    yield node
    node.destroy_node()


def call(client, name):
    asking = client.create_client(Trigger, name)
    wait_for(asking.service_is_ready)
    return asking.call_async(Trigger.Request())


def answer(request, response):
    response.success = True
    return response


def offered(client):
    return dict(client.get_service_names_and_types_by_node("bus", "/")).keys()


def test_they_belong_to_the_node_and_follow_its_rules(client, node):
    services = UrgentServices(node)
    services.offer(Trigger, "stop", answer)
    services.offer(Trigger, "~/stop", answer)
    services.start()
    for name in ("/halt", "/bus/stop"):
        future = call(client, name)
        wait_for(future.done)
        assert future.result().success
    assert {"/halt", "/bus/stop"} <= offered(client)
    services.close()
    wait_for(lambda: "/halt" not in offered(client))


def test_one_that_takes_its_time_delays_no_other(client, node):
    go = threading.Event()
    services = UrgentServices(node)
    services.offer(Trigger, "slow", lambda *both: (go.wait(30.0), answer(*both))[1])
    services.offer(Trigger, "quick", answer)
    services.start()
    slow = [call(client, "slow") for _ in range(2)]
    quick = call(client, "quick")
    wait_for(quick.done)
    assert not any(future.done() for future in slow)
    go.set()
    wait_for(lambda: all(future.done() for future in slow))
    services.close()
    services.close()


def test_an_error_is_an_answer_without_success(client, node):
    def fail(request, response):
        raise RuntimeError

    services = UrgentServices(node)
    services.offer(Trigger, "fail", fail)
    services.start()
    for _ in range(2):
        future = call(client, "fail")
        wait_for(future.done)
        assert not future.result().success
    services.close()
