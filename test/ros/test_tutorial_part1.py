"""What tutorial part 1 shows, over real topics and the simulated bus."""

import math
import time
from functools import partial

import pytest
from rclpy.parameter import Parameter
from robot_under_test import wait_for
from std_msgs.msg import Float64

DEGREE = math.radians(1)


def near(value: float, tolerance: float = 1.0 * DEGREE):
    return pytest.approx(value, abs=tolerance)


def test_a_command_moves_the_joint_there(pointing_robot):
    pointing_robot.command("head_pan_controller/command", 0.5)
    wait_for(lambda: pointing_robot.pan == near(0.5))
    pan, tilt = pointing_robot.at_rest()
    assert pan == near(0.5)
    assert tilt == near(0.0)


def test_the_speed_can_be_set(pointing_robot):
    pointing_robot.command("head_pan_controller/speed", 0.5)
    pointing_robot.command("head_pan_controller/command", 0.0)
    pointing_robot.at_rest()
    velocities = pointing_robot.listen_to_velocity("head_pan_joint")
    pointing_robot.command("head_pan_controller/command", 1.0)
    wait_for(lambda: pointing_robot.pan == near(1.0))
    assert 0.4 < max(velocities) < 0.65


def test_a_target_in_base_link_pans_left_and_tilts_down(pointing_robot):
    pointing_robot.look_at(1, 1, 0, "base_link")
    wait_for(lambda: pointing_robot.pan > 0.7)
    pan, tilt = pointing_robot.at_rest()
    assert pan == near(math.atan2(1, 1 - 0.0115))
    assert 0.2 < tilt < 0.5


def test_the_same_in_torso_link_tilts_slightly_higher(pointing_robot):
    pointing_robot.look_at(1, 1, 0, "base_link")
    wait_for(lambda: pointing_robot.pan > 0.7)
    _, tilt_base = pointing_robot.at_rest()
    pointing_robot.look_at(1, 1, 0, "torso_link")
    wait_for(lambda: pointing_robot.tilt < tilt_base - 5 * DEGREE)
    _, tilt_torso = pointing_robot.at_rest()
    assert 0.0 < tilt_torso < tilt_base


@pytest.mark.parametrize("start", [(1.2, 0.6), (-2.0, -0.8)])
def test_a_far_target_in_head_pan_link_centres_the_head_from_anywhere(pointing_robot, start):
    pointing_robot.command("head_pan_controller/command", start[0])
    pointing_robot.command("head_tilt_controller/command", start[1])
    wait_for(lambda: (pointing_robot.pan, pointing_robot.tilt) == near(start))
    pointing_robot.look_at(100, 0, 0, "head_pan_link")
    wait_for(lambda: (pointing_robot.pan, pointing_robot.tilt) == near((0.0, 0.0)))


@pytest.mark.parametrize("z", [0.05, 0.01])
def test_a_target_above_the_axis_sent_again_and_again_raises_the_head(pointing_robot, z):
    """With z = 0.01, the tutorial's value, one step is less than half a tick of the servo."""
    commands = pointing_robot.goals()
    pointing_robot.command("head_tilt_controller/command", 0.0)
    pointing_robot.at_rest()
    start = pointing_robot.true("head_tilt_joint")

    def followed(steps: int) -> bool:
        """Whether the head has been sent on, and has come there; else a target is left out."""
        return len(commands) == steps and pointing_robot.tilt == near(
            commands[-1]["head_tilt_joint"].position, 0.6 * DEGREE
        )

    for step in range(1, 13):
        pointing_robot.look_at(5, 0, z, "head_link")
        wait_for(partial(followed, step))
        time.sleep(0.15)
    _, tilt = pointing_robot.at_rest()
    # twelve steps upwards, give or take a tick and what the servo leaves uncorrected
    assert tilt - start == near(-12 * math.atan2(z, 4.91), 0.6 * DEGREE)


def test_a_relaxed_joint_is_moved_by_hand_and_the_joint_states_follow(pointing_robot):
    pointing_robot.command("head_pan_controller/command", 0.3)
    wait_for(lambda: pointing_robot.pan == near(0.3))
    assert pointing_robot.call("head_pan_controller/torque_enable", False).success
    pointing_robot.simulated.lead("head_pan_joint", -0.7, 0.5)
    wait_for(lambda: pointing_robot.pan == near(-0.7, 2 * DEGREE))
    pan, _ = pointing_robot.at_rest()
    assert pointing_robot.pan == near(pan)


def test_torque_holds_against_the_hand(pointing_robot):
    pointing_robot.command("head_pan_controller/command", 0.3)
    wait_for(lambda: pointing_robot.pan == near(0.3))
    pointing_robot.simulated.lead("head_pan_joint", -0.7, 0.5)
    time.sleep(0.7)
    pan, _ = pointing_robot.at_rest()
    assert pan == near(0.3, 6 * DEGREE)


def test_a_joint_switched_on_after_the_hand_does_not_jump_back(pointing_robot):
    pointing_robot.command("head_pan_controller/command", 0.3)
    wait_for(lambda: pointing_robot.pan == near(0.3))
    pointing_robot.call("head_pan_controller/torque_enable", False)
    pointing_robot.simulated.lead("head_pan_joint", -0.7, 0.5)
    wait_for(lambda: pointing_robot.pan == near(-0.7, 2 * DEGREE))
    pan, _ = pointing_robot.at_rest()
    assert pointing_robot.call("head_pan_controller/torque_enable", True).success
    time.sleep(0.3)
    assert pointing_robot.at_rest()[0] == near(pan)


def test_nothing_moves_at_the_start(pointing_robot):
    pointing_robot.simulated.lead("head_tilt_joint", 0.8, 0.3)
    wait_for(lambda: pointing_robot.tilt == near(0.8, 2 * DEGREE))
    pan, tilt = pointing_robot.at_rest()
    time.sleep(0.5)
    assert pointing_robot.at_rest() == near((pan, tilt))


def test_the_head_says_that_it_arrived_and_by_how_much_it_misses(pointing_robot):
    errors = pointing_robot.listen("point_head/pointing_error", Float64)
    pointing_robot.look_at(1, 1, 0, "base_link")
    text = pointing_robot.logged("arrived: the head misses the target by")
    assert "did not arrive" not in text
    assert errors[-1].data < 1.2 * DEGREE


def test_a_head_that_is_held_says_that_it_did_not_arrive(pointing_robot):
    pointing_robot.look_at(1, 0, 0, "head_pan_link")
    pointing_robot.logged("arrived: the head misses")
    pointing_robot.simulated.port.push(1, 3.0)  # twice what the servo can stand against
    pointing_robot.look_at(1, -0.3, 0, "head_pan_link")
    pointing_robot.logged("did not arrive: the head misses the target by")


def test_the_head_recentres_on_request(pointing_robot):
    pointing_robot.look_at(1, 1, 0, "base_link")
    wait_for(lambda: pointing_robot.pan > 0.7)
    assert pointing_robot.call("point_head/recenter").success
    wait_for(lambda: (pointing_robot.pan, pointing_robot.tilt) == near((0.0, 0.0)))


def test_max_velocity_can_be_lowered_while_running(pointing_robot):
    node = pointing_robot.composition.nodes["point_head"]
    result = node.set_parameters([Parameter("max_velocity", value=0.4)])
    assert result[0].successful
    velocities = pointing_robot.listen_to_velocity("head_pan_joint")
    pointing_robot.look_at(1, 1, 0, "base_link")
    wait_for(lambda: pointing_robot.pan == near(math.atan2(1, 1 - 0.0115)))
    assert max(velocities) < 0.55


def test_relax_switches_all_torque_off(pointing_robot):
    pointing_robot.look_at(1, 1, 0, "base_link")
    wait_for(lambda: pointing_robot.pan > 0.7)
    answer = pointing_robot.call("relax")
    assert answer.success
    assert answer.message == "head_pan_joint, head_tilt_joint: relaxed"
    pointing_robot.look_at(1, -1, 0, "base_link")
    pan, _ = pointing_robot.at_rest()
    assert pan > 0.7


def test_the_world_is_below_the_robot(pointing_robot):
    core = pointing_robot.composition.buffer.core
    found = core.lookup_transform("world", "base_link").transform
    assert found.translation == pytest.approx((0, 0, 0.0325))


def test_the_frames_can_be_printed(pointing_robot):
    tree = pointing_robot.call("robot_state_publisher/frames").message
    assert tree.splitlines()[:3] == ["world", "└── base_link", "    └── torso_link"]
    assert "camera_optical_frame" in tree
