"""Nodes that send targets are switched off and on, and say so to whoever comes later."""

from typing import Any

import pytest
from rclpy.node import Node
from std_msgs.msg import Bool
from std_srvs.srv import SetBool
from waiting import wait_for

from head_tracking.ros.kit.qos import LATCHED
from head_tracking.ros.targets.detection_target import DetectionTargetNode
from head_tracking.ros.targets.fictitious_target import FictitiousTargetNode
from head_tracking.ros.targets.frame_target import FrameTargetNode
from head_tracking.ros.targets.target_mux import TargetMuxNode
from head_tracking.ros.targets.visual_target import VisualTargetNode


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
def test_enabled_is_latched(threads, name, make):
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
