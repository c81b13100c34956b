"""Whatever comes in on a topic: no callback raises, and so no node ends.

Topics of the page: test_viewer_strangers.py.
"""

import math
import random
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from random_messages import NUMBERS, TEXTS, message_with, spoiled
from sensor_msgs.msg import CompressedImage, JointState, RegionOfInterest
from std_msgs.msg import String

from head_tracking.ros.kit.images import camera_info, image_message
from head_tracking.ros.robot.joint_state_publisher import JointStatePublisherNode
from head_tracking.ros.robot.robot_state_publisher import RobotStatePublisherNode
from head_tracking.tf import TransformException
from head_tracking.tf.messages import header
from head_tracking.vision import DETECTORS, camera_with_view

pytestmark = pytest.mark.filterwarnings("default::RuntimeWarning")  # numbers near 1e308

CAMERA = camera_with_view(64, 48, 1.0)
STARTS = (b"", b"\xff\xd8\xff\xe0", b"\x89PNG\r\n\x1a\n", b"RVL")
FORMATS = ("", "jpeg", "rgb8; jpeg compressed bgr8", "16UC1; compressedDepth png", "?")
JOINTS = ("", "head_pan_joint", "head_tilt_joint", "left_wheel_joint", "?")


def image(rnd):
    encoding, shape, kind = rnd.choice(
        (("bgr8", (48, 64, 3), np.uint8), ("16UC1", (48, 64), np.uint16))
    )
    pixels = np.random.default_rng(rnd.randrange(1000)).integers(0, 255, shape, kind)
    return spoiled(rnd, image_message(header(10**9, "camera"), encoding, pixels))


def compressed(rnd):
    data = rnd.choice(STARTS) + rnd.randbytes(rnd.choice((0, 9, 99)))
    return CompressedImage(header=header(10**9, "camera"), format=rnd.choice(FORMATS), data=data)


def info(rnd):
    return spoiled(rnd, camera_info(header(10**9, "camera"), CAMERA))


@pytest.mark.parametrize(
    ("follow", "transport"), [("colour", "compressed"), *((one, "raw") for one in DETECTORS)]
)
def test_visual_target_survives_every_image(world, follow, transport):
    pytest.importorskip("cv2", reason="needs OpenCV: pip install -r requirements/vision.txt")
    from head_tracking.ros.targets.visual_target import VisualTargetNode

    raw = transport == "raw"
    topics = ("/image", "/depth") if raw else ("/image/compressed", "/depth/compressedDepth")
    world.publishers.update(dict.fromkeys(topics, 1))
    parameters = {"follow": follow, "image_transport": transport}
    parameters["depth_transport"] = "raw" if raw else "compressedDepth"
    world.make(VisualTargetNode, parameters, buffer=world.buffer)
    rnd = random.Random(3)
    for _ in range(150):
        world.publish("/camera_info", info(rnd))
        for topic in topics:
            if rnd.random() < 0.7:
                world.publish(topic, image(rnd) if raw else compressed(rnd))
        if rnd.random() < 0.1:
            world.publish("/visual_target/select", message_with(rnd, RegionOfInterest))
        world.run(0.002)


def test_detection_target_survives_every_detection(world):
    vision = pytest.importorskip("vision_msgs.msg")
    from head_tracking.ros.targets.detection_target import DetectionTargetNode

    world.make(DetectionTargetNode, {"source": "detections_2d"}, buffer=world.buffer)
    rnd = random.Random(4)
    for _ in range(300):
        world.publish("/camera_info", info(rnd))
        world.publish("/depth", image(rnd))
        result = vision.ObjectHypothesisWithPose()
        result.hypothesis.class_id, result.hypothesis.score = "person", 0.9
        one = vision.Detection2D(id=rnd.choice(("", "a", "é")), results=[spoiled(rnd, result)])
        one.bbox.center.position.x = one.bbox.center.position.y = 20.0
        one.bbox.size_x = one.bbox.size_y = rnd.choice((10.0, *NUMBERS))
        found = vision.Detection2DArray(header=header(10**9, "camera"))
        found.detections = [spoiled(rnd, one)]
        world.publish("/detections", spoiled(rnd, found))
        world.run(0.002)


def transform(rnd):
    message = TransformStamped(child_frame_id=rnd.choice(TEXTS))
    message.header = header(rnd.choice((0, 1, 100, 101)) * 10**9, rnd.choice(TEXTS))
    return spoiled(rnd, message)


def joints(rnd):
    names = [rnd.choice(JOINTS) for _ in range(2)]
    message = JointState(name=names, position=[0.1, 0.2], velocity=[0.0, 0.0])
    message.header = header(rnd.choice((1, 100, 101)) * 10**9, "")
    return spoiled(rnd, message)


def description(rnd, urdf):
    start, length = rnd.randrange(len(urdf)), rnd.choice((1, 3, 30))
    insert = rnd.choice(("", "1e999", '"', "<", "é", "-", "<link name='q'/>"))
    broken = urdf[:start] + insert + urdf[start + length :]
    return String(
        data=rnd.choice(("", "<robot", "<robot name='x'/>", urdf, broken, broken, broken))
    )


def test_the_state_publishers_survive_random_messages(kinectbot, world):
    rnd, urdf = random.Random(1), kinectbot.urdf
    output = ["--ros-args", "-r", "joint_states:=completed"]
    world.make(RobotStatePublisherNode, {"robot_description": urdf}, buffer=world.buffer)
    world.make(JointStatePublisherNode, {}, cli_args=output)
    world.publish("/robot_description", String(data=urdf))
    sent = world.record("/completed")
    for _ in range(1500):
        kind = rnd.randrange(40)
        if kind == 0:
            world.publish("/robot_description", description(rnd, urdf))
        elif kind < 25:
            world.publish("/servo_states" if kind < 15 else "/joint_states", joints(rnd))
        else:
            data = SimpleNamespace(transforms=[transform(rnd) for _ in range(3)])
            world.publish("/tf" if kind < 35 else "/tf_static", data)
        world.run(0.002)
        try:
            frames = rnd.choice(TEXTS), rnd.choice(TEXTS)
            found = world.buffer.lookup_transform(*frames, transform(rnd).header.stamp)
        except TransformException:
            continue
        to, turn = found.transform.translation, found.transform.rotation
        assert all(map(math.isfinite, (to.x, to.y, to.z, turn.x, turn.y, turn.z, turn.w)))
    assert sent
    for _, message in sent:
        assert len(message.name) == len(message.position)
        assert all(map(math.isfinite, message.position)), "a joint is nowhere"
