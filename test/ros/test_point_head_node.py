"""point_head alone in a process, and in simulated time."""

import math
import random

import pytest
from action_client import ABORTED, SUCCEEDED, Client
from head_under_test import Head
from robot_under_test import wait_for
from std_msgs.msg import String

from head_tracking.nodes.point_head import PointHeadNode
from head_tracking.tf.qos import LATCHED

goals = pytest.importorskip("goals")
goal, following, JOINTS = goals.point_goal, goals.following, goals.JOINTS


@pytest.mark.parametrize("model", ["kinectbot", "turtlebot"])
def test_random_goals_report_the_miss_of_the_true_angles(request, threads, model):
    """In simulated time; scripts/benchmark/measure interfaces does 1,000 of them."""
    pointed, rnd = goals.PointedHead(request.getfixturevalue(model)), random.Random(1)
    ends = {"succeeded": 0, "aborted": 0}
    for _ in range(30):
        point, before = goals.random_point(rnd), pointed.true
        goal = pointed.look_at(point)
        pointed.world.run(0.02)
        ends[goal.status] += 1
        truly = math.degrees(pointed.true_miss(point))
        if goal.status == "succeeded":
            assert pointed.head.gaze(point, *before).reached
            reported = float(pointed.said.split()[-2])
            assert pointed.said.startswith("arrived")
            assert truly == pytest.approx(reported, abs=0.5)
            assert truly < 1.0
        else:
            assert not pointed.head.gaze(point, *before).reached
            assert pointed.said.startswith("aborted: the target is ")
            assert pointed.true == pytest.approx(before, abs=0.006)
    assert min(ends.values()) > 2
    pointed.node.destroy_node()


def test_alone_in_a_process_it_serves_goals_too(kinectbot):
    head = Head(PointHeadNode, kinectbot.urdf)
    try:
        client = Client(head.robot, goals.PointHead, "point_head/point_head_action")
        wait_for(lambda: any("ready to point" in text for text in head.log))
        sent = client.send(goal(1, 1, 0.3))
        assert sent.ended()[0] == SUCCEEDED
        assert head.positions[0] == pytest.approx(math.atan2(1, 0.99), abs=0.02)
        assert sent.feedback[0][1].pointing_angle_error > 0.5
        owners = head.robot.create_publisher(String, "joint_owners", LATCHED)
        mine = "head_pan_joint: {0}\nhead_tilt_joint: {0}"
        owners.publish(String(data=mine.format("/somebody")))
        wait_for(lambda: "/somebody" in head.node.interface.obstacle)
        assert not client.send(goal(1, 0, 0.3)).accepted
        head.until_logged("is rejected: the joints belong to /somebody")
        owners.publish(String(data=mine.format("/point_head")))
        wait_for(lambda: not head.node.interface.obstacle)
        sent = client.send(goal(1, -1, 0.3, velocity=0.3))
        wait_for(lambda: head.positions[0] < 0.7)
        head.measured = False
        assert sent.ended()[0] == ABORTED
        assert "aborted: no position of head_pan_joint" in head.until_logged("aborted: no pos")
        head.measured = True
        wait_for(lambda: not head.node.interface.obstacle)
        follower = Client(head.robot, goals.FollowJointTrajectory, goals.FOLLOW)
        sent = follower.send(following((1.0, (0.0, 0.0)), path=dict.fromkeys(JOINTS, 0.2)))
        assert sent.ended()[0] == SUCCEEDED
    finally:
        head.close()
