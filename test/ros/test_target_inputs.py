"""Targets are heard whatever their publishers promise."""

import os
import subprocess
import sys
from itertools import product

import pytest
from geometry_msgs.msg import Point, PointStamped
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String
from waiting import wait_for

from head_tracking.ros.kit.topics import TopicListener

PROMISES = list(
    product(
        (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT),
        (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL),
    )
)


@pytest.fixture(scope="module")
def robot(make_module_robot):
    robot = make_module_robot("--target", "mux")
    mux = robot.composition.nodes["target_mux"]
    robot.fixed_frame = mux.get_parameter("fixed_frame").value  # in which it passes them on
    mux.set_parameters([Parameter("switch_time", value=0.0)])
    return robot


@pytest.mark.parametrize("topic", ["target_point", "clicked_point"])
@pytest.mark.parametrize(("reliability", "durability"), PROMISES)
def test_targets_are_received_from_publishers_of_any_qos(robot, reliability, durability, topic):
    qos = QoSProfile(depth=5, reliability=reliability, durability=durability)
    publisher = robot.node.create_publisher(PointStamped, topic, qos)
    number = PROMISES.index((reliability, durability))
    away = 2.0 + 0.1 * number + (0.05 if topic != "target_point" else 0.0)
    message = PointStamped(point=Point(x=away, y=0.0, z=0.0))
    message.header.frame_id = robot.fixed_frame
    tracker = robot.composition.nodes["head_tracker"]

    def heard() -> bool:
        publisher.publish(message)
        target = tracker.control.frames.target
        return target is not None and target.point[0] == pytest.approx(away)

    try:
        wait_for(heard)
    finally:
        robot.node.destroy_publisher(publisher)


# Publishes one message on each topic, as soon as somebody listens, and stays for their delivery.
PERSON = """
import sys, time, rclpy
from std_msgs.msg import String
rclpy.init()
node = rclpy.create_node("person")
for topic in sys.argv[1:]:
    publisher = node.create_publisher(String, topic, 10)
    while not publisher.get_subscription_count():
        time.sleep(0.001)
    publisher.publish(String(data=topic))
sys.stdin.read()
"""


def test_the_only_message_of_a_new_publisher_is_received(bench):
    topics, heard = [f"topic_{number}" for number in range(60)], []
    for topic in topics:
        TopicListener(bench.person.node, String, topic, lambda message: heard.append(message.data))
    with subprocess.Popen(
        [sys.executable, "-c", PERSON, *topics],
        env=os.environ | {"ROS_DOMAIN_ID": bench.domain},
        stdin=subprocess.PIPE,
    ):
        wait_for(lambda: sorted(heard) == sorted(topics))
