"""Whatever comes in on a topic of images or detections: no callback raises, and so no node ends."""

import math
import random
from importlib.util import find_spec

import numpy as np
import pytest
from lockstep import World

if find_spec("cv2") is None:
    pytest.skip("needs OpenCV: pip install -r requirements/vision.txt", allow_module_level=True)

from sensor_msgs.msg import CameraInfo, CompressedImage, Image, RegionOfInterest

from head_tracking.ros.kit.images import camera_info, image_message
from head_tracking.ros.targets.visual_target import VisualTargetNode
from head_tracking.tf.messages import header
from head_tracking.vision import DETECTORS, camera_with_view

pytestmark = pytest.mark.filterwarnings("default::RuntimeWarning")  # numbers near 1e308

CAMERA = camera_with_view(64, 48, 1.0)
NUMBERS = (0.0, 1.0, -1.0, 0.5, 60.0, 1e-320, 1e12, 1e308, math.nan, math.inf, -math.inf)
ENCODINGS = (
    "", "rgb8", "bgr8", "bgra8", "mono8", "mono16", "16UC1", "32FC1", "8UC3", "yuv422",
    "bayer_rggb8", "RGB8", "64FC1", "é",
)  # fmt: skip
FORMATS = ("", "jpeg", "png", "rgb8; jpeg compressed bgr8", "16UC1; compressedDepth png", "?")


def stamped(rnd: random.Random):
    head = header(rnd.choice((0, 1, 10**9, 10**9 + rnd.randrange(10**9), 2 * 10**18)), "camera")
    head.frame_id = rnd.choice(("camera", "camera", "camera", "", "/camera", "é"))
    return head


def info(rnd: random.Random) -> CameraInfo:
    message = camera_info(stamped(rnd), CAMERA)
    for name in rnd.sample(("k", "p", "r", "d"), rnd.randrange(3)):
        values = [rnd.choice(NUMBERS) for _ in range(len(getattr(message, name)) or 5)]
        if name == "d":
            values = values[: rnd.randrange(6)]
        setattr(message, name, values)
    if rnd.random() < 0.3:
        message.width, message.height = rnd.choice((0, 1, 64, 2**32 - 1)), rnd.choice((0, 48, 1))
        message.distortion_model = rnd.choice(("", "plumb_bob", "equidistant", "?"))
        message.binning_x = rnd.choice((0, 1, 2, 1000))
    return message


def image(rnd: random.Random) -> Image:
    if rnd.random() < 0.5:  # a good one, with one thing wrong or none
        rng = np.random.default_rng(rnd.randrange(1000))
        message = image_message(stamped(rnd), "bgr8", rng.integers(0, 255, (48, 64, 3), np.uint8))
    else:
        message = Image(header=stamped(rnd), width=64, height=48)
        message.data = bytes(rnd.choice((0, 1, 100, 48 * 64, 48 * 64 * 2, 48 * 64 * 4)))
        message.step = 64 * rnd.choice((1, 2, 3, 4))
        message.encoding = rnd.choice(ENCODINGS)
    name, value = rnd.choice(
        (
            ("encoding", rnd.choice(ENCODINGS)), ("step", rnd.choice((0, 1, 2**32 - 1))),
            ("width", rnd.choice((0, 1, 65, 2**32 - 1))), ("height", rnd.choice((0, 1, 2**32 - 1))),
            ("is_bigendian", 1), ("data", b""),
        )
    )  # fmt: skip
    if rnd.random() < 0.6:
        setattr(message, name, value)
    return message


def compressed(rnd: random.Random) -> CompressedImage:
    start = rnd.choice((b"", b"\xff\xd8\xff\xe0", b"\x89PNG\r\n\x1a\n", b"RVL"))
    return CompressedImage(
        header=stamped(rnd),
        format=rnd.choice(FORMATS),
        data=start + rnd.randbytes(rnd.choice((0, 9, 99))),
    )


@pytest.fixture
def world(kinectbot, threads):
    return World(kinectbot)


@pytest.mark.parametrize("transport", ["raw", "compressed"])
@pytest.mark.parametrize("follow", sorted(DETECTORS))
def test_visual_target_survives_every_image(world, follow, transport):
    raw = transport == "raw"
    kinds = {
        "/image" if raw else "/image/compressed": image if raw else compressed,
        "/depth" if raw else "/depth/compressedDepth": image if raw else compressed,
    }
    world.publishers.update(dict.fromkeys(kinds, 1))
    depth_transport = "raw" if raw else "compressedDepth"
    parameters = {"follow": follow, "image_transport": transport}
    node = world.make(
        VisualTargetNode,
        {**parameters, "depth_transport": depth_transport},
        buffer=world.buffer,
    )
    rnd = random.Random(3)
    for _ in range(150):
        world.publish("/camera_info", info(rnd))
        for topic, make in kinds.items():
            if rnd.random() < 0.7:
                world.publish(topic, make(rnd))
        if rnd.random() < 0.1:
            x, y, width, height = (rnd.choice((0, 1, 20, 64, 2**32 - 1)) for _ in range(4))
            region = RegionOfInterest(x_offset=x, y_offset=y, width=width, height=height)
            world.publish("/visual_target/select", region)
        world.run(0.002)
    node.destroy_node()


def test_detection_target_survives_every_detection(world):
    vision = pytest.importorskip("vision_msgs.msg")
    from head_tracking.ros.targets.detection_target import DetectionTargetNode

    node = world.make(DetectionTargetNode, {"source": "detections_2d"}, buffer=world.buffer)
    rnd = random.Random(4)
    for _ in range(500):
        world.publish("/camera_info", info(rnd))
        world.publish("/depth", image(rnd))
        found = []
        for _ in range(rnd.randrange(4)):
            one = vision.Detection2D(id=rnd.choice(("", "a", "é")))
            centre = one.bbox.center.position
            centre.x, centre.y, one.bbox.size_x, one.bbox.size_y = (
                rnd.choice(NUMBERS) for _ in range(4)
            )
            result = vision.ObjectHypothesisWithPose()
            result.hypothesis.class_id = rnd.choice(("", "person"))
            result.hypothesis.score = rnd.choice(NUMBERS)
            one.results = [result][: rnd.randrange(2)]
            found.append(one)
        message = vision.Detection2DArray(header=stamped(rnd), detections=found)
        world.publish("/detections", message)
        world.run(0.002)
    node.destroy_node()
