"""Nodes that send targets are switched off and on, and say so to whoever comes later."""

from typing import Any

import pytest
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from std_msgs.msg import Bool
from std_srvs.srv import SetBool
from waiting import wait_for

from head_tracking.nodes.detection_target import DetectionTargetNode
from head_tracking.nodes.fictitious_target import FictitiousTargetNode
from head_tracking.nodes.frame_target import FrameTargetNode
from head_tracking.nodes.target_mux import TargetMuxNode
from head_tracking.nodes.visual_target import VisualTargetNode
from head_tracking.tf.qos import LATCHED


def switch(person: Node, name: str, on: bool) -> Any:
    client = person.create_client(SetBool, f"{name}/enable")
    wait_for(client.service_is_ready)
    future = client.call_async(SetBool.Request(data=on))
    wait_for(future.done)
    return future.result()


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("fictitious_target", FictitiousTargetNode),
        ("frame_target", FrameTargetNode),
        ("target_mux", TargetMuxNode),
        ("visual_target", VisualTargetNode),
        ("detection_target", DetectionTargetNode),
    ],
)
def test_what_is_on_is_said_to_whoever_comes_later(threads, name, make):
    if name in ("visual_target", "detection_target"):
        pytest.importorskip("cv2", reason="needs OpenCV: pip install -r requirements/vision.txt")
    if name == "detection_target":
        pytest.importorskip("vision_msgs")
    person = Node("person")
    threads.start(make())
    threads.start(person)
    assert switch(person, name, False).success
    said: list[bool] = []
    person.create_subscription(Bool, f"{name}/enabled", lambda m: said.append(m.data), LATCHED)
    wait_for(lambda: said == [False])
    assert switch(person, name, True).success
    wait_for(lambda: said == [False, True])


def test_a_target_that_is_switched_off_is_not_sent(threads):
    person = Node("person")
    targets: list[PointStamped] = []
    person.create_subscription(PointStamped, "target_point", targets.append, 10)
    threads.start(FictitiousTargetNode())
    threads.start(person)
    wait_for(lambda: targets)
    assert switch(person, "fictitious_target", False).success
    # what was under way has come when the next answer has
    assert switch(person, "fictitious_target", False).success
    targets.clear()
    ticks: list[int] = []
    person.create_timer(0.05, lambda: ticks.append(1))
    wait_for(lambda: len(ticks) > 10)
    assert not targets
