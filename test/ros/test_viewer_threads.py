"""What several browsers ask of the robot at a time, each in a thread of its own."""

import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from types import SimpleNamespace
from typing import Any

import pytest
from contract_nodes import ControllerStandIn
from geometry_msgs.msg import PointStamped
from std_msgs.msg import Header
from viewing import PATIENCE, view
from waiting import repeating, wait_for

from head_tracking.page.head_modes import Mode
from head_tracking.ros.kit.spinning import NodeThreads
from head_tracking.ros.targets.latest_target import LatestTarget
from head_tracking.transforms import Transform, TransformBuffer


@pytest.fixture
def robot(threads) -> Any:
    return view(threads).robot


class SlowController(ControllerStandIn):
    """A controller that is switched when it may be."""

    may = threading.Event()

    def switch(self, on: bool) -> None:
        self.may.wait(PATIENCE)
        super().switch(on)


def test_two_choices_of_a_mode_leave_one_node_in_charge(threads, robot):
    tracker = ControllerStandIn("head_tracker")
    threads.start(tracker)
    with closing(NodeThreads()) as elsewhere, ThreadPoolExecutor(2) as browsers:
        pointer = SlowController("point_head", on=False)
        elsewhere.start(pointer)
        wait_for(lambda: Mode.POINT in robot.modes.possible(), PATIENCE)
        wait_for(lambda: robot.modes.mode() is Mode.TRACK, PATIENCE)
        first = browsers.submit(robot.modes.set_mode, Mode.POINT)
        wait_for(lambda: pointer.asked == [True], PATIENCE)
        second = browsers.submit(robot.modes.set_mode, Mode.TRACK)
        wait_for(lambda: second.running() or second.done())
        time.sleep(0.5)  # in which the second one may end, without an answer to the first
        pointer.may.set()
        first.result(PATIENCE)
        assert second.result(PATIENCE).done
        wait_for(lambda: (tracker.on, pointer.on) == (True, False))
        wait_for(lambda: robot.modes.mode() is Mode.TRACK)


def test_joints_that_are_moved_all_the_time_are_published_all_the_time(threads, robot):
    """More often than messages go out."""
    wait_for(lambda: robot.joints.free, PATIENCE)

    def is_published() -> bool:
        robot.joints.move({"head_pan_joint": 0.25})
        return robot.observe().joints.get("head_pan_joint") == pytest.approx(0.25)

    wait_for(is_published, PATIENCE)
    assert threads.failure is None


class Listens:
    """The parts of a node that a listener needs, without threads of ROS's own."""

    heard: Callable[[PointStamped], None]

    def create_subscription(self, *arguments: Any, **_: Any) -> None:
        self.heard = arguments[2]

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=time.monotonic_ns()))


def test_targets_come_in_another_thread_than_they_are_asked_for():
    """Some wait for their frame, others are placed at once."""
    buffer, node, interval = TransformBuffer(), Listens(), sys.getswitchinterval()
    buffer.set_transform(0, "base_link", "camera", Transform.identity(), static=True)
    targets = LatestTarget(node, buffer)
    targets.place_in("base_link")

    def send() -> None:
        waits, placed = (PointStamped(header=Header(frame_id=one)) for one in ("nowhere", "camera"))
        for message in (*[waits] * 19, placed):
            node.heard(message)

    sys.setswitchinterval(1e-6)  # threads take turns as often as they can
    try:
        with repeating(send):
            for _ in range(100_000):
                targets.latest()
    finally:
        sys.setswitchinterval(interval)
    node.heard(PointStamped(header=Header(frame_id="camera")))
    assert targets.latest() is not None
