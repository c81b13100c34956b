"""A configuration that can't work ends the run and says why; a model without a head is said."""

import pytest

from head_tracking.ros.spinning import EXPLAINED


@pytest.mark.parametrize(
    ("ros_args", "words"),
    [
        (["-p", "servo_bus:head_pan_controller.motor.max:=1024"], "1024.*0 to 1023"),
        (["-p", "servo_bus:head_pan_controller.motor.init:=2000"], "init"),
        (["-p", "servo_bus:head_tilt_controller.motor.id:=1"], "id 1 is used twice"),
        (["-p", "servo_bus:dynamixels:=[head_pan, head_roll]"], "head_roll_controller.motor.id"),
        (["-p", "servo_bus:update_rate:=0.0"], "update_rate"),
        (["-p", "servo_bus:update_rate:=fast"], "update_rate"),
        (["-p", "robot_state_publisher:world_transform:=[0.0, 1.0]"], "six finite numbers"),
    ],
)
def test_a_configuration_that_cannot_work_is_an_error(make_robot, ros_args, words):
    with pytest.raises(EXPLAINED, match=words):
        make_robot("--mode", "point", ros_args=ros_args)


def test_a_robot_that_is_not_there_is_an_error(make_robot):
    with pytest.raises(FileNotFoundError, match=r"no robot 'nobot'.*kinectbot, turtlebot"):
        make_robot("--robot", "nobot")


def test_a_model_without_the_named_joints_is_said_and_nothing_ends(make_robot):
    robot = make_robot(
        "--mode", "point", ros_args=["-p", "point_head:head_pan_joint:=neck_yaw_joint"]
    )
    said = robot.logged("no joint 'neck_yaw_joint'")
    assert "head_pan_joint, head_tilt_joint" in said
    assert robot.threads.failure is None


def test_a_frame_that_the_head_does_not_carry_is_said_and_nothing_ends(make_robot):
    robot = make_robot("--mode", "point", ros_args=["-p", "point_head:pointing_frame:=torso_link"])
    robot.logged("not carried")
    assert robot.threads.failure is None
