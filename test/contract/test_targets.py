"""What can be the target: points, poses, frames, images; several of them by priority."""

import math
import signal
import time

import pytest
from geometry_msgs.msg import Point, PointStamped, PoseStamped
from rclpy.time import Time
from rig import DEGREE, bearing
from std_msgs.msg import Float64, String
from waiting import wait_for

from head_tracking.tf import Buffer, TransformListener

MUX = ("-p", "target_mux:sources:=[clicked_point, target_pose, face]")


@pytest.fixture
def tracked(bench):
    """A simulated head that looks at what it is given."""
    bench.start("head_tracking", "--sim", "--target", "none")
    bench.person.wait_for_joints()
    return bench


@pytest.fixture(scope="module")
def mixed(module_bench):
    """One that looks at the most important of several targets."""
    module_bench.start("head_tracking", "--sim", "--target", "mux", "--ros-args", *MUX)
    module_bench.person.wait_for_joints()
    wait_for(lambda: module_bench.person.latched("target_mux/selected") == "")
    return module_bench.person


def test_a_frame_is_followed_and_one_that_does_not_exist_is_named(tracked):
    person = tracked.person
    frame = ("frame_target", "--ros-args", "-p")
    unknown = tracked.start(*frame, "frame:=left_hand")
    person.complaint("frame_target", "left_hand")
    assert unknown.end(signal.SIGINT) == 0, unknown.output
    eye = tracked.start(*frame, "frame:=left_eye_link", "-p", "offset:=[1.0, 1.0, 0.0]")
    targets = person.hear("target_point", PointStamped)
    wait_for(lambda: person.state("head_tracker") != "idle")
    wait_for(lambda: person.pan > 0.3)
    assert all(math.isfinite(target.point.x) for target in targets)
    assert eye.end(signal.SIGINT) == 0, eye.output
    wait_for(lambda: person.state("head_tracker") == "holding")


def test_the_most_important_target_is_taken_smoothly_and_the_next_when_it_ends(mixed):
    sent = mixed.hear("target_point", PointStamped)

    def selected(name, *topics):
        def publish_and_look():
            for topic, side in topics:
                mixed.publish(topic, mixed.point(2, side, 0.6))
            time.sleep(0.02)
            return mixed.latched("target_mux/selected") == name

        return publish_and_look

    wait_for(selected("face", ("face/target_point", 1)))
    wait_for(lambda: sent and sent[-1].point.y == pytest.approx(1.0))
    mixed.publish("clicked_point", mixed.point(2, -1, 0.6))  # one click
    wait_for(selected("clicked_point", ("face/target_point", 1)))
    wait_for(lambda: abs(sent[-1].point.y + 1.0) < 1e-6)
    assert sum(-0.95 < message.point.y < 0.95 for message in sent) > 3  # no jump
    count = len(sent)
    wait_for(lambda: len(sent) > count + 10)  # a click is held
    wait_for(lambda: mixed.pan < -0.3)


def test_a_pose_can_be_the_target_and_another_source_can_be_pinned(mixed):
    pose = PoseStamped(header=mixed.point(0, 0, 0).header)
    pose.pose.position = Point(x=1.0, y=0.5, z=0.7)
    mixed.publish("target_mux/pin", String(data="target_pose"))

    def selected(name):
        pose.header.stamp = mixed.node.get_clock().now().to_msg()
        mixed.publish("target_pose", pose)
        return mixed.latched("target_mux/selected") == name

    wait_for(lambda: selected("target_pose"))
    wait_for(lambda: mixed.pan > 0.3)
    mixed.complaint(
        "target_mux", "nobody", of=lambda: mixed.publish("target_mux/pin", String(data="nobody"))
    )
    mixed.publish("target_mux/pin", String(data="face"))
    wait_for(lambda: mixed.latched("target_mux/selected") == "")
    for far in (math.nan, 1e300):
        impossible = mixed.point(far, 0, 0)
        mixed.log.clear()
        mixed.complaint(
            "target_mux",
            "face",
            of=lambda: mixed.publish("face/target_point", impossible),  # noqa: B023
        )
    mixed.publish("target_mux/pin", String())
    wait_for(lambda: selected("target_pose") or mixed.latched("target_mux/selected") != "")


def test_the_fictitious_target_is_switched_off_and_on(bench):
    bench.start("fictitious_target")
    targets = bench.person.hear("target_point", PointStamped)
    wait_for(lambda: targets)
    assert bench.person.call("fictitious_target/enable", False).success

    def is_silent():
        count = len(targets)
        time.sleep(0.3)
        return len(targets) == count

    wait_for(is_silent)
    count = len(targets)
    assert bench.person.call("fictitious_target/enable", True).success
    wait_for(lambda: len(targets) > count + 3)


def test_a_target_of_the_heads_camera_is_used_at_its_stamp(tracked):
    """A ball stands still; the camera says where it saw it late, but with the picture's time."""
    person, ball = tracked.person, PointStamped(point=Point(x=1.5, y=0.8, z=0.3))
    ball.header.frame_id = "base_link"
    buffer = Buffer()
    listener = TransformListener(buffer, person.node)
    errors = person.hear("head_tracker/tracking_error", Float64)

    def followed():
        if buffer.can_transform("camera_optical_frame", "base_link", Time()):
            seen = buffer.transform(ball, "camera_optical_frame")
            time.sleep(0.08)  # the picture is processed
            person.publish("target_point", seen)
        is_there = abs(person.pan - bearing(1.5, 0.8)) < 2 * DEGREE
        return is_there and len(errors) > 40 and errors[-1].data < 1.5 * DEGREE

    wait_for(followed)
    listener.unregister()
