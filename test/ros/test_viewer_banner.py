"""Servos and hardware, joints that fall silent and nodes that have gone, as the page shows them."""

from typing import Any

import pytest
from contract_nodes import ControllerStandIn
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool
from viewing import PATIENCE, view
from waiting import wait_for

from head_tracking.page.head_modes import Mode

JOINTS = ("head_pan_joint", "head_tilt_joint")


@pytest.fixture
def seen(threads, monkeypatch) -> Any:
    monkeypatch.setattr("head_tracking.page.robot._PATIENCE", 0.5)
    return view(threads).robot


def test_joint_states_that_end_are_missed_until_they_come_again(seen):
    wait_for(lambda: seen.joints.free, PATIENCE)
    assert not seen.silent_joints(), "nobody has promised any"
    measuring = Node("encoders")
    publisher = measuring.create_publisher(JointState, "joint_states", 10)
    wait_for(lambda: not seen.joints.free, PATIENCE)

    def measured() -> bool:
        message = JointState(name=list(JOINTS), position=[0.1, 0.2])
        message.header.stamp = measuring.get_clock().now().to_msg()
        publisher.publish(message)
        return seen.silent_joints() == ()

    wait_for(lambda: seen.silent_joints() == JOINTS, PATIENCE)  # none has come
    wait_for(measured, PATIENCE)
    wait_for(lambda: seen.silent_joints() == JOINTS, PATIENCE)
    measuring.destroy_node()


def test_with_servos_the_page_never_publishes_the_joints_itself(seen):
    wait_for(lambda: seen.joints.free, PATIENCE)
    bus = Node("servo_bus")
    bus.create_service(SetBool, "head_pan_controller/torque_enable", lambda _, answer: answer)
    wait_for(lambda: not seen.joints.free, PATIENCE)
    bus.destroy_node()
    wait_for(lambda: not seen.joints.servos(), PATIENCE)
    wait_for(lambda: seen.silent_joints() == JOINTS, PATIENCE)
    assert not seen.joints.free


def test_a_tracker_that_goes_away_is_missed_until_it_comes_again(seen):
    assert seen.modes.missing() == (), "there was none"
    node = ControllerStandIn("head_tracker")
    wait_for(lambda: seen.modes.mode() is Mode.TRACK, PATIENCE)
    assert seen.modes.missing() == ()
    node.destroy_node()
    wait_for(lambda: seen.modes.missing() == ("head_tracker",), PATIENCE)
    node = ControllerStandIn("head_tracker")
    wait_for(lambda: seen.modes.missing() == (), PATIENCE)
    node.destroy_node()


def test_without_hardware_the_page_says_where_the_joints_are(seen):
    wait_for(lambda: seen.model() is not None and seen.joints.free)
    assert "head_pan_joint" not in seen.observe().joints
    assert seen.joints.move({"head_pan_joint": 0.4}).done
    wait_for(lambda: seen.observe().joints.get("head_pan_joint") == pytest.approx(0.4))
    assert seen.observe().joints["head_tilt_joint"] == 0.0
    assert not seen.stop_everything().wait().done
    assert seen.modes.set_mode(Mode.TRACK, "") == (False, seen.stop.refusal)
    assert not seen.stop.resume().done
    assert not seen.modes.centre().done
    assert "not running" in seen.modes.set_mode(Mode.TRACK, "").text


def test_the_log_has_the_token_of_a_page_for_the_network(threads, capfd):
    node = view(threads, host="0.0.0.0")
    assert f"/?token={node.page.token}" in capfd.readouterr().err
