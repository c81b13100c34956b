"""Nodes that turn a head which another controller drives."""

from types import SimpleNamespace

import pytest
import rclpy
from head_under_test import LATCHED, Head
from rclpy.parameter import Parameter
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from waiting import wait_for

from head_tracking.control import ControlLoop
from head_tracking.exceptions import HeadTrackingError
from head_tracking.ros.head.head_tracker import HeadTrackerNode
from head_tracking.ros.head.point_head import PointHeadNode
from head_tracking.transforms import TransformBuffer

trajectory_msgs = pytest.importorskip("trajectory_msgs.msg")
TOPIC = "/head_controller/joint_trajectory"
DRIVEN = {"command_interface": "joint_trajectory"}


class DrivenHead(Head):
    """Its joints go where the last trajectory has them."""

    def __init__(self, make, urdf, **parameters):
        self.trajectories = []
        super().__init__(make, urdf, **DRIVEN, **parameters)
        self.robot.create_subscription(
            trajectory_msgs.JointTrajectory, TOPIC, self._on_trajectory, 10
        )
        self.stopped = []
        self.robot.create_subscription(
            Bool, "stopped", lambda m: self.stopped.append(m.data), LATCHED
        )
        wait_for(lambda: self.robot.count_publishers(TOPIC))

    def _on_trajectory(self, message):
        (point,) = message.points
        self.trajectories.append((message, point))
        self._goals, self.speeds = list(point.positions), [6.0, 6.0]

    def trigger(self, service):
        client = self.robot.create_client(Trigger, service)
        wait_for(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        wait_for(future.done)
        return future.result()


@pytest.fixture(params=[HeadTrackerNode, PointHeadNode])
def head(request, kinectbot):
    head = DrivenHead(request.param, kinectbot.urdf)
    yield head
    head.close()


def test_a_trajectory_controller_is_driven_held_by_stop_and_resumed(head):
    head.target = ("torso_link", lambda now: (2.0, 1.0, 0.1))
    wait_for(lambda: head.errors and head.errors[-1] < 0.02)
    assert head.positions[0] > 0.4
    assert head.commands == 0  # no joint_commands
    message, point = head.trajectories[-1]
    assert message.joint_names == ["head_pan_joint", "head_tilt_joint"]
    assert message.header.stamp.sec == 0
    assert point.time_from_start.nanosec == 0
    head.target = ("torso_link", lambda now: (2.0, -1.0, 0.1))
    wait_for(lambda: head.positions[0] < 0.3)
    answer = head.trigger("stop")
    assert not answer.success
    assert "head_pan_joint" in answer.message
    wait_for(lambda: head.stopped and head.stopped[-1])
    count = len(head.trajectories)
    head.travel.clear()
    wait_for(lambda: len(head.travel) > 40)  # targets keep coming
    assert len(head.trajectories) <= count + 1
    assert head.farthest() < 0.2
    head.travel.clear()
    assert head.trigger("resume").success
    wait_for(lambda: not head.stopped[-1] and head.errors and head.errors[-1] < 0.02)
    pans = [pan for pan, _ in head.travel]
    assert head.positions[0] < -0.4
    assert max(abs(b - a) for a, b in zip(pans, pans[5:], strict=False)) < 0.1  # 0.3 rad/s


def test_command_interface_joint_trajectory_is_refused_beside_a_servo_bus():
    rclpy.init()
    try:
        loop = ControlLoop(TransformBuffer())
        loop.attach(SimpleNamespace(period=0.02))
        overrides = [Parameter(name, value=value) for name, value in DRIVEN.items()]
        with pytest.raises(HeadTrackingError, match="the servo bus runs in this process"):
            PointHeadNode(loop=loop, parameter_overrides=overrides)
    finally:
        rclpy.shutdown()
