"""What the page calls for help for: joints that fall silent, nodes that go away."""

from importlib.util import find_spec
from typing import Any

import pytest
from contract_nodes import ControllerStandIn
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool
from waiting import wait_for

from head_tracking.nodes.viewer import ViewerNode
from head_tracking.page.head_modes import Mode
from head_tracking.ros.kit.spinning import NodeThreads
from head_tracking.ros.robot.robot_state_publisher import RobotStatePublisherNode

pytestmark = pytest.mark.skipif(
    find_spec("nicegui") is None,
    reason="NiceGUI is missing: pip install -r requirements/viewer.txt",
)
PATIENCE = 30.0
JOINTS = ["head_pan_joint", "head_tilt_joint"]


@pytest.fixture
def threads(threads: NodeThreads) -> NodeThreads:
    threads.start(RobotStatePublisherNode())
    return threads


@pytest.fixture
def seen(threads) -> Any:
    node = ViewerNode()
    threads.start(node)
    wait_for(node.robot.model, PATIENCE)
    return node.robot


def test_joint_states_that_stop_are_missed_until_they_come_again(threads, seen):
    wait_for(lambda: seen.joints.free, PATIENCE)
    assert not seen.silent_joints(), "nobody has promised any"
    measuring = Node("encoders")
    publisher = measuring.create_publisher(JointState, "joint_states", 10)
    wait_for(lambda: not seen.joints.free, PATIENCE)
    wait_for(lambda: list(seen.silent_joints()) == JOINTS, PATIENCE)  # never came

    def speaking() -> bool:
        message = JointState(name=JOINTS, position=[0.1, 0.2])
        message.header.stamp = measuring.get_clock().now().to_msg()
        publisher.publish(message)
        return seen.silent_joints() == ()

    wait_for(speaking, PATIENCE)
    assert not seen.silent_joints()
    wait_for(lambda: list(seen.silent_joints()) == JOINTS, PATIENCE)  # stopped
    measuring.destroy_node()


def test_with_servos_the_page_never_says_itself_where_the_joints_are(threads, seen):
    wait_for(lambda: seen.joints.free, PATIENCE)
    bus = Node("servo_bus")
    bus.create_service(SetBool, "head_pan_controller/torque_enable", lambda _, answer: answer)
    wait_for(lambda: not seen.joints.free, PATIENCE)
    bus.destroy_node()
    wait_for(lambda: not seen.joints.servos(), PATIENCE)
    wait_for(lambda: list(seen.silent_joints()) == JOINTS, PATIENCE)
    assert not seen.joints.free


def test_a_tracker_that_goes_away_is_missed_until_it_comes_again(threads, seen):
    assert seen.modes.missing() == (), "there was none"
    node = ControllerStandIn("head_tracker")
    wait_for(lambda: seen.modes.mode() is Mode.TRACK, PATIENCE)
    assert seen.modes.missing() == ()
    node.destroy_node()
    wait_for(lambda: seen.modes.missing() == ("head_tracker",), PATIENCE)
    node = ControllerStandIn("head_tracker")
    wait_for(lambda: seen.modes.missing() == (), PATIENCE)
    node.destroy_node()
