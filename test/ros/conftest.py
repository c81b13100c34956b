import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from typing import Any

# nodes of one process only: neither other programs nor shared memory files
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "OFF"
os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"

import pytest
import rclpy
from lockstep import World
from rclpy.signals import SignalHandlerOptions
from rig import Bench
from robot_under_test import Robot

from head_tracking.ros.kit.spinning import NodeThreads

MakeRobot = Callable[..., Robot]


def _robots() -> Iterator[MakeRobot]:
    with ExitStack() as robots:

        def make(*arguments: str, ros_args: list[str] | None = None, wait: bool = True) -> Robot:
            robot = Robot(["--sim", *arguments], ros_args or [], wait)
            robots.callback(robot.close)
            return robot

        yield make


make_robot = pytest.fixture(_robots)
make_module_robot = pytest.fixture(_robots, scope="module", name="make_module_robot")


@pytest.fixture
def threads() -> Iterator[NodeThreads]:
    """ROS, and what spins nodes in it until the end of the test."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        with closing(NodeThreads()) as threads:
            yield threads
    finally:
        rclpy.try_shutdown()


@pytest.fixture
def start(threads) -> Callable[[Any], Any]:
    """Starts to spin a node, and returns it."""

    def start(node: Any) -> Any:
        threads.start(node)
        return node

    return start


@pytest.fixture
def world(kinectbot, threads) -> World:
    return World(kinectbot)


@pytest.fixture
def bench(tmp_path, monkeypatch) -> Iterator[Bench]:
    """Other programs, and nodes each of a process of its own for all that DDS knows."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with closing(Bench(tmp_path)) as bench:
        yield bench
