"""What several browsers ask of the robot at a time, each in a thread of its own."""

import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any

import pytest
from contract_nodes import ControllerStandIn
from geometry_msgs.msg import PointStamped
from rclpy.parameter import Parameter
from std_msgs.msg import Header
from waiting import wait_for

from head_tracking.nodes.viewer import ViewerNode
from head_tracking.page.head_modes import Mode
from head_tracking.ros.kit.spinning import NodeThreads
from head_tracking.ros.robot.robot_state_publisher import RobotStatePublisherNode
from head_tracking.ros.targets.latest_target import LatestTarget
from head_tracking.transforms import Transform, TransformBuffer

pytestmark = pytest.mark.skipif(
    find_spec("nicegui") is None,
    reason="NiceGUI is missing: pip install -r requirements/viewer.txt",
)
PATIENCE = 30.0


@pytest.fixture
def robot(threads) -> Any:
    threads.start(RobotStatePublisherNode())
    node = ViewerNode(parameter_overrides=[Parameter("port", value=0)])
    threads.start(node)
    wait_for(node.robot.model, PATIENCE)
    return node.robot


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


def test_nothing_ends_while_joints_come_to_be_moved_by_hand(threads, robot):
    """So many that they are still read for a message when the next one comes."""
    wait_for(lambda: robot.joints.free, PATIENCE)
    robot.joints.move({f"joint_{number}": 0.1 for number in range(20_000)})
    for number in range(40):
        time.sleep(0.055)
        robot.joints.move({f"another_{number}": 0.1})
    assert threads.failure is None
    assert robot.joints.move({"head_pan_joint": 0.25}).done
    wait_for(lambda: robot.observe().joints.get("head_pan_joint") == pytest.approx(0.25), PATIENCE)


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
    ended = threading.Event()

    def send() -> None:
        waits, placed = (PointStamped(header=Header(frame_id=one)) for one in ("nowhere", "camera"))
        while not ended.is_set():
            for message in (*[waits] * 19, placed):
                node.heard(message)

    sending = threading.Thread(target=send)
    sys.setswitchinterval(1e-6)  # threads take turns as often as they can
    try:
        sending.start()
        for _ in range(300_000):
            targets.latest()
    finally:
        sys.setswitchinterval(interval)
        ended.set()
        sending.join()
    node.heard(PointStamped(header=Header(frame_id="camera")))
    assert targets.latest() is not None


def test_a_joint_that_is_moved_all_the_time_is_published_all_the_time(robot):
    wait_for(lambda: robot.joints.free, PATIENCE)
    begun = time.monotonic()

    def moved() -> bool:
        """Faster than messages go out."""
        robot.joints.move({"head_pan_joint": 0.1 + 0.01 * (time.monotonic() - begun)})
        return "head_pan_joint" in robot.observe().joints

    while not moved():
        assert time.monotonic() < begun + PATIENCE
        time.sleep(0.01)
