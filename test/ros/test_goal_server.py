"""Action servers whose goals a loop carries out; the executor of events: test_head_actions.py."""

import threading

import pytest
from action_client import ABORTED, ACCEPTED, SUCCEEDED, Client
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from waiting import join, wait_for

from head_tracking.head.motions import MotionEnd
from head_tracking.ros.head import head_actions
from head_tracking.ros.head.goal_server import serve_goals
from head_tracking.ros.head.point_head import PointHeadNode
from head_tracking.ros.kit import spinning

actions = pytest.importorskip("control_msgs.action")


def test_goals_end_once_from_any_thread(monkeypatch, start):
    """With a middleware that reports no events."""

    class Unsupported(SingleThreadedExecutor):
        def spin_once(self, timeout_sec=None):
            raise rclpy_implementation.RCLError("not supported")

    monkeypatch.setattr(spinning, "EventsExecutor", Unsupported)
    server, begun = Node("serves"), []

    def refusal(goal):
        return "too fast" if goal.max_velocity > 9.0 else ""

    serve_goals(server, actions.PointHead, "~/goals", refusal, begun.append)
    start(server)
    assert type(server.executor) is SingleThreadedExecutor
    client = Client(start(Node("asks")), actions.PointHead, "/serves/goals")
    assert not client.send(actions.PointHead.Goal(max_velocity=10.0)).accepted
    result = actions.PointHead.Result()
    for end, status in (
        (MotionEnd.SUCCEEDED, SUCCEEDED),
        (MotionEnd.MISSED, ABORTED),
        (MotionEnd.CANCELED, ABORTED),  # nobody has asked for that
    ):
        sent = client.send(actions.PointHead.Goal())
        wait_for(lambda: begun)  # the client hears that it is accepted before
        goal = begun.pop()
        wait_for(lambda sent=sent: sent.status == ACCEPTED)
        goal.feedback(actions.PointHead.Feedback(pointing_angle_error=0.5))
        wait_for(lambda sent=sent: sent.feedback)
        thread = threading.Thread(target=goal.end, args=[end, result])
        thread.start()
        join(thread)
        goal.end(MotionEnd.MISSED, result)  # too late
        assert sent.ended()[0] == status
        assert not sent.cancel().goals_canceling


def test_missing_message_packages_are_reported(threads, monkeypatch, capfd):
    monkeypatch.setattr(head_actions, "PointHead", None)
    monkeypatch.setattr(head_actions, "TrajectoryMessage", None)
    node = PointHeadNode()
    topics = dict(node.get_subscriber_names_and_types_by_node("point_head", "/"))
    (line,) = [line for line in capfd.readouterr().err.splitlines() if "not installed" in line]
    assert "no actions: control_msgs is not installed" in line
    assert "no joint_trajectory: trajectory_msgs is not installed" in line
    assert "/target_point" in topics
    assert "/point_head/joint_trajectory" not in topics
