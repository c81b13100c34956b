"""Bad input gets a clear error and nothing moves."""

import math
import time

import pytest
from robot_under_test import wait_for
from sensor_msgs.msg import JointState

DEGREE = math.radians(1)


@pytest.fixture(scope="module")
def robot(make_module_robot):
    robot = make_module_robot("--mode", "point")
    robot.command("head_pan_controller/command", 0.3)
    robot.command("head_tilt_controller/command", 0.2)
    wait_for(lambda: (robot.pan, robot.tilt) == pytest.approx((0.3, 0.2), abs=1.5 * DEGREE))
    robot.at_rest()
    return robot


@pytest.fixture
def nothing_moves(robot):
    before = robot.at_rest(1.1)  # a stream of errors is logged once a second
    robot.forget_log()
    yield
    time.sleep(0.3)
    assert robot.at_rest() == pytest.approx(before, abs=0.1 * DEGREE)


@pytest.mark.usefixtures("nothing_moves")
@pytest.mark.parametrize(
    ("target", "words"),
    [
        ((1, 0, 0, "nose_link"), "frame 'nose_link' does not exist"),
        ((1, 0, 0, ""), "no frame name"),
        ((1, 0, 0, "/base_link"), "start without a slash"),
        ((math.nan, 0, 0, "base_link"), "is not finite"),
        ((1, math.inf, 0, "base_link"), "is not finite"),
        ((-2, 0, 0.1, "head_pan_link"), "out of reach: it needs head_pan_joint 3.14 rad"),
        ((0.0115, 0, 3, "head_pan_link"), "on the pan axis"),
        ((0.0, 0, 0, "camera_link"), "too close"),
    ],
)
def test_a_bad_target_is_refused(robot, target, words):
    robot.look_at(*target)
    assert "refused" in robot.logged(words)


@pytest.mark.usefixtures("nothing_moves")
@pytest.mark.parametrize("value", [2.7, -3.0, math.nan, math.inf])
def test_a_command_beyond_the_limits_is_refused(robot, value):
    robot.command("head_pan_controller/command", value)
    robot.logged("command refused: head_pan_joint: goal position")


@pytest.mark.usefixtures("nothing_moves")
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_an_impossible_speed_is_refused(robot, value):
    robot.command("head_pan_controller/speed", value)
    robot.logged("speed refused: head_pan_joint: speed")


@pytest.mark.usefixtures("nothing_moves")
@pytest.mark.parametrize(
    ("names", "positions", "velocities", "words"),
    [
        (["head_pan_joint"], [0.5, 0.5], [], "1 names, 2 positions and 0 velocities"),
        (["head_pan_joint"], [], [], "1 names, 0 positions"),
        ([], [], [], "0 names"),
        (["nose_joint"], [0.5], [], "no joint 'nose_joint'"),
        (["head_pan_joint", "head_tilt_joint"], [0.5, math.nan], [], "head_tilt_joint"),
        (["head_pan_joint"], [0.5], [0.0], "speed 0.0"),
    ],
)
def test_bad_joint_commands_are_refused_as_a_whole(robot, names, positions, velocities, words):
    robot.publish("joint_commands", JointState(name=names, position=positions, velocity=velocities))
    assert "joint_commands refused" in robot.logged(words)


def test_joint_commands_are_clamped_to_the_limits(robot):
    robot.forget_log()
    robot.publish("joint_commands", JointState(name=["head_tilt_joint"], position=[3.0]))
    robot.logged(
        "head_tilt_joint: the goal 3.000 rad is beyond the servo's limit; 1.473 rad is used"
    )
    wait_for(lambda: robot.tilt == pytest.approx(1.473, abs=1.5 * DEGREE))
    robot.command("head_tilt_controller/command", 0.2)
    wait_for(lambda: robot.tilt == pytest.approx(0.2, abs=1.5 * DEGREE))


def test_commands_for_a_joint_relaxed_on_request_do_nothing(robot):
    robot.forget_log()
    assert robot.call("head_pan_controller/torque_enable", False).success
    pan, _ = robot.at_rest()
    robot.command("head_pan_controller/command", 1.0)
    robot.logged("command refused")
    robot.publish("joint_commands", JointState(name=["head_pan_joint"], position=[1.0]))
    robot.logged("relaxed on request")
    assert robot.at_rest()[0] == pytest.approx(pan, abs=0.1 * DEGREE)
    assert robot.call("torque_enable", True).success
    robot.command("head_pan_controller/command", 0.3)
    wait_for(lambda: robot.pan == pytest.approx(0.3, abs=1.5 * DEGREE))
