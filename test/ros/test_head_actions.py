"""PointHead and FollowJointTrajectory, as stock clients use them."""

import math
import time

import pytest

pytest.importorskip("control_msgs.action")

from action_client import ABORTED, CANCELED, SUCCEEDED, Client
from control_msgs.action import FollowJointTrajectory, PointHead
from goals import FOLLOW, following, point_goal, trajectory
from rig import DEGREE, JOINTS, bearing
from std_msgs.msg import String
from trajectory_msgs.msg import MultiDOFJointTrajectoryPoint
from waiting import wait_for

from head_tracking.ros.head import head_actions
from head_tracking.ros.kit.topics import LATCHED


@pytest.fixture(scope="module")
def running(make_module_robot):
    robot = make_module_robot("--mode", "point")
    robot.until_done("torque_enable", True)  # which may take long at first
    robot.client = Client(robot.node, PointHead, "point_head/point_head_action")
    robot.states = robot.hear("point_head/state", String, LATCHED)
    return robot


@pytest.fixture
def robot(running):
    """Awake, and looking about straight on."""
    interface = running.composition.nodes["point_head"].control
    if interface.off:
        running.call("resume")
        running.call("point_head/enable", True)
        wait_for(lambda: not interface.off)
        running.until_done("torque_enable", True)
        interface.is_cautious = False
    if abs(running.pan) > 0.1 or interface.motion is not interface.targets:
        assert running.client.send(point_goal(3, 0, 0.4, velocity=5.0)).ended()[0] == SUCCEEDED
    running.log.clear()
    return running


def test_a_goal_succeeds_when_the_measured_joints_have_arrived(robot):
    sent = robot.client.send(point_goal(1, 1, 0.2))
    status, _ = sent.ended()
    assert status == SUCCEEDED
    assert "arrived" in robot.logged("turning camera_link to (1.000, 1.000, 0.200) in base_link: ")
    assert robot.true(JOINTS[0]) == pytest.approx(bearing(1, 1), abs=DEGREE)
    wait_for(lambda: sent.feedback and sent.feedback[-1][1].pointing_angle_error < DEGREE)
    assert sent.feedback[0][1].pointing_angle_error > 0.6  # measured, not meant
    assert len(sent.feedback) > 3


def test_cancel_holds(robot):
    sent = robot.client.send(point_goal(1, 2, 0.2, velocity=0.5))
    wait_for(lambda: robot.pan > 0.2)
    assert len(sent.cancel().goals_canceling) == 1
    assert sent.ended()[0] == CANCELED
    pan, _ = robot.at_rest()
    assert 0.2 < pan < 1.0  # its target is at 1.1
    wait_for(lambda: robot.states[-1].data == "canceled: the head holds")
    assert not sent.cancel().goals_canceling


def test_invalid_goals_are_rejected(robot):
    for wrong in (
        point_goal(math.nan, 0, 0),
        point_goal(1e308, 0, 0),
        point_goal(1, 0, 0, "nowhere"),
        point_goal(1, 0, 0, ""),
        point_goal(1, 0, 0, pointing="torso_link"),
        point_goal(1, 0, 0, pointing="nose"),
        point_goal(1, 0, 0, velocity=-1),
        point_goal(1, 0, 0, velocity=math.inf),
        point_goal(1, 0, 0, axis=(math.nan, 0, 0)),
    ):
        robot.states.clear()
        assert not robot.client.send(wrong).accepted
        wait_for(lambda: robot.states and robot.states[-1].data.startswith("rejected: "))
    # a valid goal afterwards shows that only the goals were wrong, not the head
    assert robot.client.send(point_goal(3, 0, 0.4)).ended()[0] == SUCCEEDED


@pytest.fixture
def follower(robot):
    robot.follower = Client(robot.node, FollowJointTrajectory, FOLLOW)
    return robot


def test_a_trajectory_is_followed_with_feedback(follower):
    """How closely: see test_point_head_node.py."""
    begun = time.monotonic()
    sent = follower.follower.send(
        following(
            (0.8, (0.5, 0.2), (0.5, 0.0), (0.0, 0.0)),
            (1.6, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
            path=dict.fromkeys(JOINTS, -1.0),  # a busy machine is late
        )
    )
    status, result = sent.ended()
    assert (status, result.error_code) == (SUCCEEDED, 0)
    assert "arrived" in result.error_string
    assert time.monotonic() - begun > 1.55
    assert max(message.actual.positions[0] for _, message in sent.feedback) > 0.3
    message = sent.feedback[len(sent.feedback) // 2][1]
    assert tuple(message.joint_names) == JOINTS
    assert message.error.positions[0] == pytest.approx(
        message.desired.positions[0] - message.actual.positions[0]
    )
    assert len(sent.feedback) > 15


def test_a_newer_trajectory_preempts_cancel_holds_and_an_empty_one_ends_it(follower):
    first = follower.follower.send(following((5.0, (2.0,)), names=JOINTS[:1]))
    wait_for(lambda: follower.pan > 0.05)
    tilt = follower.tilt
    second = follower.follower.send(following((5.0, (-2.0,)), names=JOINTS[:1]))
    status, result = first.ended()
    assert (status, result.error_code) == (ABORTED, -1)
    assert "preempted by a newer goal" in result.error_string
    second.cancel()
    assert second.ended()[0] == CANCELED
    third = follower.follower.send(following((5.0, (2.0,)), names=JOINTS[:1]))
    wait_for(lambda: follower.pan > 0.1)
    assert follower.follower.send(following(names=())).ended()[0] == SUCCEEDED
    assert third.ended()[0] == ABORTED
    pan, _ = follower.at_rest()
    assert 0.05 < pan < 1.5
    assert follower.tilt == pytest.approx(tilt, abs=0.012)


def test_invalid_trajectories_are_aborted_with_their_code(follower):
    def code(*points, **options):
        status, result = follower.follower.send(following(*points, **options)).ended()
        assert status == ABORTED
        assert result.error_string
        return result.error_code

    assert code((1.0, (9.0, 0.0))) == -1
    assert code((1.0, (0.0,)), names=("nose",)) == -2
    assert code((1.0, (0.0, 0.0)), stamp=time.time() - 5.0) == -3
    assert code((0.2, (1.5, 0.0)), path={JOINTS[0]: 0.05}) == -4
    assert code((0.1, (-1.5, 0.0)), time=0.05, end={JOINTS[0]: 0.01}) == -5
    assert code((1.0, (0.0, 0.0)), path={"nose": 0.1}) == -2
    other = following(names=())
    other.multi_dof_trajectory.points = [MultiDOFJointTrajectoryPoint()]
    status, result = follower.follower.send(other).ended()
    assert (status, result.error_code) == (ABORTED, -1)
    assert code((1.0, (0.0, 0.0)), end={JOINTS[0]: -2.0}) == -1
    follower.until_done("stop")
    assert code((1.0, (0.0, 0.0))) == -1
    stopped = "a trajectory is rejected: the head is stopped"
    follower.complaint("point_head", stopped, of=lambda: code((1.0, (0.0, 0.0))))


def test_a_stop_and_resume_while_a_trajectory_is_examined_end_it(follower, monkeypatch):
    def examining(*_):
        follower.composition.loop.stop()
        follower.composition.loop.backend.resume()

    monkeypatch.setattr(head_actions, "checked_waypoints", examining)
    before = follower.at_rest()
    sent = follower.follower.send(following((0.5, (0.5, 0.1))))
    assert sent.ended()[0] == ABORTED
    assert follower.at_rest() == pytest.approx(before, abs=0.02)


def test_the_trajectory_topic_accepts_a_stream(robot):
    for k in range(25):
        robot.publish("point_head/joint_trajectory", trajectory((0.1, (0.02 * k, 0.0))))
        time.sleep(0.02)

    def arrives():  # also if a servo was silent for a moment
        robot.publish("point_head/joint_trajectory", trajectory((0.3, (0.48, 0.0))))
        time.sleep(0.4)
        return robot.pan == pytest.approx(0.48, abs=0.03)

    wait_for(arrives)
    robot.publish("point_head/joint_trajectory", trajectory((1.0, (7.0, 0.0))))
    robot.logged("a trajectory is rejected: point 1 of 1 takes head_pan_joint to 7 rad")
    later = trajectory((0.5, (-0.3, 0.0)), stamp=time.time() + 0.6)
    robot.publish("point_head/joint_trajectory", later)
    sent = robot.client.send(point_goal(3, 0.3, 0.4))
    assert sent.ended()[0] == SUCCEEDED
    time.sleep(0.8)  # the goal came later
    assert robot.pan == pytest.approx(0.1, abs=0.05)
