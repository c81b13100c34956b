"""config/head.rviz on a running head: every display finds its topic. RViz itself is not here."""

from pathlib import Path
from typing import Any

import yaml
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from waiting import wait_for

CONFIG = Path(__file__).parents[2] / "config" / "head.rviz"

SHOWN = {
    "RobotModel": ("Description Topic", "std_msgs/msg/String"),
    "PointStamped": ("Topic", "geometry_msgs/msg/PointStamped"),
}


def displays() -> dict[str, Any]:
    manager = yaml.safe_load(CONFIG.read_text())["Visualization Manager"]
    return {display["Class"].split("/")[1]: display for display in manager["Displays"]}


def test_displays_and_tools_find_their_topics_with_a_quality_that_fits(make_robot):
    robot = make_robot()
    found = displays()
    for kind, (key, type_name) in SHOWN.items():
        topic = found[kind][key]
        senders = wait_for(
            lambda name=topic["Value"]: robot.node.get_publishers_info_by_topic(name)
        )
        for sender in senders:
            assert sender.topic_type == type_name
            if topic["Reliability Policy"] == "Reliable":
                assert sender.qos_profile.reliability is ReliabilityPolicy.RELIABLE
            if topic["Durability Policy"] == "Transient Local":
                assert sender.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
    assert "world" in robot.composition.buffer.core.frames()

    # what a person points at reaches the head
    manager = yaml.safe_load(CONFIG.read_text())["Visualization Manager"]
    (tool,) = [one for one in manager["Tools"] if one["Class"].endswith("/PublishPoint")]
    topic = tool["Topic"]["Value"]
    for listener in wait_for(lambda: robot.node.get_subscriptions_info_by_topic(topic)):
        assert listener.topic_type == "geometry_msgs/msg/PointStamped"
