"""What can be the target: points, poses, frames, images; several of them by priority."""

import math
import signal
import time
from itertools import product

import pytest
import yaml
from geometry_msgs.msg import Point, PointStamped, PoseStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rig import DEGREE, SOURCE, bearing
from std_msgs.msg import String
from waiting import wait_for

MUX = ("-p", "target_mux:sources:=[clicked_point, target_pose, face]")
PROMISES = [
    *product(
        (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT),
        (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL),
    )
]


@pytest.fixture(scope="module")
def mixed(module_bench):
    """Somebody beside a simulated head that looks at the most important of several targets."""
    module_bench.start("head_tracking", "--sim", "--target", "mux", "--ros-args", *MUX)
    module_bench.person.wait_for_joints()
    wait_for(lambda: module_bench.person.latched("target_mux/selected") == "")
    return module_bench.person


@pytest.fixture
def tracked(mixed):
    """The same; the head looks ahead, and at what is published on its own topic."""
    mixed.publish("target_mux/pin", String(data="face"))
    wait_for(lambda: mixed.latched("target_mux/selected") == "")
    mixed.until_done("head_tracker/recenter")
    wait_for(lambda: mixed.looks_at(0.0, 0.0))
    yield mixed
    mixed.publish("target_mux/pin", String())


def test_a_frame_is_followed_and_one_that_does_not_exist_is_named(module_bench, tracked):
    frame = ("frame_target", "--ros-args", "-p")
    unknown = module_bench.start(*frame, "frame:=left_hand")
    tracked.complaint("frame_target", "left_hand")
    assert unknown.end(signal.SIGINT) == 0, unknown.output
    eye = module_bench.start(*frame, "frame:=left_eye_link", "-p", "offset:=[1.0, 1.0, 0.0]")
    targets = tracked.hear("target_point", PointStamped)
    wait_for(lambda: tracked.state("head_tracker") != "idle")
    wait_for(lambda: tracked.pan > 0.3)
    assert all(math.isfinite(target.point.x) for target in targets)
    assert eye.end(signal.SIGINT) == 0, eye.output
    wait_for(lambda: tracked.state("head_tracker") == "holding")


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


@pytest.mark.parametrize("topic", ["target_point", "clicked_point"])
def test_targets_are_received_from_publishers_of_any_qos(request, topic):
    person = request.getfixturevalue("tracked" if topic == "target_point" else "mixed")
    sides = 0.4, -0.4, 0.4, -0.4
    for y, (reliability, durability) in zip(sides, PROMISES, strict=True):
        qos = QoSProfile(depth=5, reliability=reliability, durability=durability)
        publisher = person.node.create_publisher(PointStamped, topic, qos)

        def is_seen(y=y, publisher=publisher):
            publisher.publish(person.point(2, y, 0.6))
            return abs(person.pan - bearing(2, y)) < 2 * DEGREE

        wait_for(is_seen)
        person.node.destroy_publisher(publisher)


def test_rviz_finds_its_topics_frame_and_tool_with_a_quality_that_fits(mixed):
    """RViz itself is not here."""
    rviz = yaml.safe_load((SOURCE / "config/head.rviz").read_text())["Visualization Manager"]
    displays = {display["Name"]: display for display in rviz["Displays"]}
    for topic, kind in (
        (displays["Robot"]["Description Topic"], "std_msgs/msg/String"),
        (displays["Target point"]["Topic"], "geometry_msgs/msg/PointStamped"),
    ):
        senders = mixed.node.get_publishers_info_by_topic
        for sender in wait_for(lambda name=topic["Value"], of=senders: of(name)):
            assert sender.topic_type == kind
            if topic["Reliability Policy"] == "Reliable":
                assert sender.qos_profile.reliability is ReliabilityPolicy.RELIABLE
            if topic["Durability Policy"] == "Transient Local":
                assert sender.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
    frames = mixed.call("robot_state_publisher/frames").message.split()
    assert rviz["Global Options"]["Fixed Frame"] in frames
    (tool,) = [one for one in rviz["Tools"] if one["Class"].endswith("/PublishPoint")]
    heard = tool["Topic"]["Value"]
    listeners = wait_for(lambda: mixed.node.get_subscriptions_info_by_topic(heard))
    assert {one.topic_type for one in listeners} == {"geometry_msgs/msg/PointStamped"}
