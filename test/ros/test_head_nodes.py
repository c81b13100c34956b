"""The nodes that turn a head, when models, servos and targets are not what they should be."""

import time

import pytest
from waiting import wait_for

from head_tracking.head.obstacle import Reason
from head_tracking.ros.head.head_tracker import HeadTrackerNode
from head_tracking.ros.head.point_head import PointHeadNode
from head_tracking.transforms import Rotation, Transform

WITHOUT_HEAD = '<robot name="arm"><link name="shoulder"/></robot>'


def at(x, y, z, frame="torso_link"):
    return frame, lambda now: (x, y, z)


LEFT, RIGHT = at(2.0, 1.0, 0.1), at(2.0, -1.0, 0.1)


def another(urdf):
    """The same robot, said again in other words."""
    return urdf.replace("</robot>", "<!-- another one --></robot>")


def test_a_disabled_tracker_stays_disabled_with_another_model(make, kinectbot):
    head = make()
    head.until("idle", "")
    assert head.call("head_tracker/enable", False).success
    head.until("disabled", Reason.DISABLED)
    head.target = LEFT
    head.describe(another(kinectbot.urdf))
    wait_for(lambda: sum("ready to point" in text for text in head.log) >= 2)
    head.travel.clear()
    wait_for(lambda: len(head.travel) > 50)
    assert head.commands <= 1
    assert head.farthest() == 0.0
    assert head.fields["state"] == "disabled"
    assert head.call("head_tracker/enable", True).success
    head.until("tracking")


def test_an_invalid_first_model_is_reported_until_another_is_received(make, kinectbot):
    head = make(urdf=WITHOUT_HEAD)
    head.until("idle", Reason.INVALID_MODEL, "head_pan_joint")
    head.describe(kinectbot.urdf)
    head.target = LEFT
    head.until("tracking")


def test_a_fixed_frame_that_moves_with_the_head_is_refused(make):
    head = make(fixed_frame="camera_link")
    head.until("idle", Reason.INVALID_MODEL, "fixed_frame", "camera_link")
    head.target = LEFT
    head.until_logged("fixed_frame")
    assert head.commands == 0


def test_a_missing_model_is_reported(make, kinectbot):
    head = make(urdf="")
    head.target = LEFT
    head.until("idle", Reason.NO_MODEL)
    head.until_logged("robot_description")


@pytest.mark.parametrize("node", [HeadTrackerNode, PointHeadNode])
def test_the_status_has_whether_there_is_a_target(make, node):
    head = make(node)
    wait_for(lambda: head.fields.get("target") == "false")
    head.target = LEFT
    wait_for(lambda: head.fields["target"] == "true")
    head.target = None
    head.travel.clear()
    wait_for(lambda: len(head.travel) > 5)  # what was sent has come
    assert head.node.control.recenter() is None
    wait_for(lambda: head.fields["target"] == "false")


def test_targets_with_stamps_in_the_future_are_refused(make):
    head = make()
    head.target = LEFT
    head.until("tracking")
    head.target = None
    head.until("holding")
    frame, path = LEFT
    stamp = head.now + 30.0
    for k in range(60):  # nobody knows the joints of that time
        head.send(frame, path(0.0), stamp + k)
        time.sleep(0.03)
    wait_for(lambda: "future" in head.fields["refusal"])
    head.until("holding")


def test_a_turning_base_is_compensated_in_the_fixed_frame(make):
    head = make(fixed_frame="odom")
    yaw = 0.0

    def drive():
        nonlocal yaw
        yaw = min(yaw + 0.01, 0.8)
        pose = Transform((0.5, 0.0, 0.0), Rotation.from_rpy(0.0, 0.0, yaw))
        head.buffer.set_transform(round(head.now * 1e9), "odom", "base_link", pose)

    head.target = at(3.0, 0.0, 0.8, "odom")
    wait_for(lambda: "odom" in head.fields["refusal"])
    head.each_period = drive
    head.until("tracking")
    wait_for(lambda: yaw == 0.8)
    head.errors.clear()
    wait_for(lambda: len(head.errors) > 30 and max(head.errors[-20:]) < 0.03)
    assert head.positions[0] == pytest.approx(-0.8, abs=0.1)
