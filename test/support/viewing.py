"""The node of the page in a test; modules that import this are skipped without NiceGUI."""

import json
from typing import Any

import pytest
from rclpy.parameter import Parameter
from waiting import PATIENCE, wait_for
from websockets.sync.client import ClientConnection, connect

pytest.importorskip("nicegui", reason="needs NiceGUI: pip install -r requirements/viewer.txt")

from head_tracking.page.viewer import ViewerNode
from head_tracking.ros.kit.spinning import NodeThreads
from head_tracking.ros.robot.robot_state_publisher import RobotStatePublisherNode


def view(
    threads: NodeThreads, namespace: str = "", *, alone: bool = True, **given: Any
) -> ViewerNode:
    """Start a page on any free port; return it when it knows the robot's model.

    Args:
        threads: spin the node.
        namespace: of the robot.
        alone: a robot_state_publisher is started as well.
        given: parameters of the page.
    """
    if alone:
        threads.start(RobotStatePublisherNode(namespace=namespace))
    parameters = [Parameter(name, value=value) for name, value in ({"port": 0} | given).items()]
    node = ViewerNode(namespace=namespace, parameter_overrides=parameters)
    threads.start(node)
    wait_for(node.robot.model)
    return node


def watch(page: Any) -> ClientConnection:
    """Connect to a page as a browser does."""
    return connect(f"ws://127.0.0.1:{page.port}/head/live")


def until(browser: ClientConnection, kind: str) -> dict[str, Any]:
    """Return the next message of a kind that a browser is sent."""
    for _ in range(1000):
        message: dict[str, Any] = json.loads(browser.recv(timeout=PATIENCE))
        if message["type"] == "state":
            browser.send("got")
        if message["type"] == kind:
            return message
    raise AssertionError(f"{kind} was not sent")
