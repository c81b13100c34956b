"""visual_target on simulated images, in simulated time: closed loops, and bad input."""

import struct
import threading
from itertools import cycle

import numpy as np
import pytest

pytest.importorskip("cv2", reason="needs OpenCV: pip install -r requirements/vision.txt")

import time

from geometry_msgs.msg import Point, PointStamped
from rclpy.parameter import Parameter
from rig import DEGREE
from sensor_msgs.msg import CameraInfo, CompressedImage, RegionOfInterest
from visual_pursuit import pursue
from waiting import PATIENCE, wait_for

from head_tracking.ros.kit.images import camera_info, image_message
from head_tracking.ros.targets.simulated_camera import SimulatedCameraNode
from head_tracking.ros.targets.visual_target import VisualTargetNode
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.tf.messages import header
from head_tracking.vision import DETECTORS, camera_with_view

SMALL = {"width": 320, "height": 240}


# closed loops


def test_closed_loop_error_of_a_detected_ball_that_is_hidden_for_a_time():
    """Also the annotated image."""
    run = pursue(
        "ball", "ball", {"follow": "colour"}, {}, duration=4.0, camera=SMALL, hide=(1, 1.5)
    )
    assert run.errors.rms < 7 * DEGREE
    assert max(run.misses) < 0.03
    assert run.images - len(run.misses) == pytest.approx(15 + 4, abs=3)
    assert (run.picture.encoding, run.picture.width, run.picture.height) == ("bgr8", 320, 240)
    pixels = np.frombuffer(run.picture.data, np.uint8).reshape(240, 320, 3)
    assert (pixels == (60, 220, 60)).all(axis=2).sum() > 100


# bad input


@pytest.fixture
def look(world):
    """A node that looks at what is published, with what it says."""

    def look(**parameters):
        node = world.make(VisualTargetNode, parameters, buffer=world.buffer)
        node.warnings = []
        node.warn = node.warnings.append
        world.run(0.1)  # the joints become known
        return node

    return look


def accepts(node, **parameter):
    """Set a parameter; return whether the node accepts it."""
    ((name, value),) = parameter.items()
    return node.set_parameters([Parameter(name, value=value)])[0].successful


CAMERA = camera_with_view(320, 240, 1.0)
ANY_FRAME = camera_info(header(1, ""), CAMERA)  # as of some drivers


def ball(depth="16UC1", size=(320, 240)):
    """A picture with a ball in the middle, and its depths: 1.5 m, and 3 m behind it."""
    width, height = size
    picture = np.full((height, width, 3), 120, np.uint8)
    v, u = np.mgrid[0:height, 0:width]
    inside = (u - 160) ** 2 + (v - 120) ** 2 < 30**2
    picture[inside] = (20, 110, 245)
    metres = np.where(inside, 1.5, 3.0)
    depths = metres.astype(np.float32) if depth == "32FC1" else (metres * 1000).astype(np.uint16)
    return picture, depths


def show(world, *, depth="16UC1", info=None, lag=0, size=(320, 240), frames=6, change=None):
    """Publishes some frames."""
    if depth:
        world.publishers["/depth"] = 1
    picture, depths = ball(depth, size)
    for _ in range(frames):
        head = header(world.now, "camera_optical_frame")
        if info is not False:
            world.publish("/camera_info", info or camera_info(head, CAMERA))
        image = image_message(head, "bgr8", picture)
        distances = image_message(header(world.now + lag, "d"), depth or "16UC1", depths)
        if change:
            change(image, distances)
        if depth:
            world.publish("/depth", distances)
        world.publish("/image", image)
        world.run(1 / 30)


@pytest.mark.parametrize(("depth", "lag"), [("16UC1", 15_000_000), ("32FC1", 0)])
def test_the_point_has_the_images_stamp_and_frame(world, look, depth, lag):
    look(follow="colour")
    targets = world.record("/target_point")
    regions = world.record("/visual_target/roi")
    show(world, depth=depth, lag=lag)
    assert len(targets) == 4
    (_, first) = targets[0]
    assert first.header.frame_id == "camera_optical_frame"
    assert (first.point.x, first.point.y, first.point.z) == pytest.approx(
        (0.5 / CAMERA.fx * 1.5, 0.5 / CAMERA.fy * 1.5, 1.5), abs=1e-3
    )
    assert (regions[-1][1].width, regions[-1][1].height) == (59, 59)


def test_images_without_stamps_get_the_time_of_their_arrival(world, look):
    """What has gone is not published any more, and forgotten after `memory`."""

    def elsewhere(image, _):
        unstamped(image, _)
        image.data = np.roll(image.data, 3 * 120).tobytes()

    def unstamped(image, _):
        image.header = header(0, image.header.frame_id)

    def empty(image, _):
        unstamped(image, _)
        image.data = bytes(len(image.data))

    look(follow="colour", object_size=0.3)
    targets = world.record("/target_point")
    show(world, depth="", info=ANY_FRAME, change=unstamped)
    assert len(targets) == 4
    assert all(now - 5e7 < stamp_to_ns(message.header.stamp) <= now for now, message in targets)
    show(world, depth="", info=ANY_FRAME, change=empty, frames=75)
    assert len(targets) == 4
    show(world, depth="", info=ANY_FRAME, change=elsewhere)
    assert len(targets) == 8


def test_late_images_are_ignored_with_a_warning(world, look):
    """Such as those of a second camera on the same topic."""
    node = look(follow="colour", distance=1.5)
    targets, late = world.record("/target_point"), cycle((False, True))

    def of_two(image, _):
        if next(late):
            image.header = header(world.now - 50_000_000, image.header.frame_id)

    show(world, depth="", change=of_two, frames=10)
    assert len(targets) == 3
    assert node.warnings


def compressed(picture, depths, kind):
    """Messages of image_transport's compressed and compressedDepth."""
    cv2 = pytest.importorskip("cv2")
    jpeg = cv2.imencode(".jpg", picture)[1].tobytes()
    if kind == "16UC1":
        header_bytes, numbers = bytes(12), depths
    else:
        a, b = 100.0 * 101.0, 1.0 - 100.0 * 101.0 / 10.0
        header_bytes = struct.pack("<iff", 0, a, b)
        numbers = np.where(np.isfinite(depths), a / depths + b, 0).astype(np.uint16)
    png = cv2.imencode(".png", numbers)[1].tobytes()
    return (
        CompressedImage(format="bgr8; jpeg compressed bgr8", data=jpeg),
        CompressedImage(format=f"{kind}; compressedDepth png", data=header_bytes + png),
    )


@pytest.mark.parametrize("kind", ["16UC1", "32FC1"])
def test_compressed_images_and_depths(world, look, kind):
    node = look(follow="colour", image_transport="compressed", depth_transport="compressedDepth")
    targets = world.record("/target_point")
    world.publishers["/depth/compressedDepth"] = 1
    picture, depths = ball(kind, (320, 240))
    for _ in range(6):
        head = header(world.now, "camera_optical_frame")
        image, depth = compressed(picture, depths, kind)
        image.header = depth.header = head
        world.publish("/camera_info", camera_info(head, CAMERA))
        world.publish("/depth/compressedDepth", depth)
        world.publish("/image/compressed", image)
        world.run(1 / 30)
    assert not node.warnings
    point = targets[-1][1].point
    assert (point.x, point.y, point.z) == pytest.approx(
        (0.5 / CAMERA.fx * 1.5, 0.5 / CAMERA.fy * 1.5, 1.5), abs=2e-2
    )
    wrong = CompressedImage(format="16UC1; compressedDepth rvl", data=bytes(40), header=head)
    world.publish("/depth/compressedDepth", wrong)
    world.publish("/image/compressed", image)
    world.run(1 / 30)
    assert len(node.warnings) == 1


def wrong_encoding(image, depth):
    image.encoding = "jpeg"


def depth_of_pictures(image, depth):
    depth.encoding = "bgr8"


@pytest.mark.parametrize(
    "options",
    [
        {"info": CameraInfo()},
        {"info": False},
        {"info": camera_info(header(1, "other_camera"), CAMERA)},
        {"change": wrong_encoding},
        {"change": depth_of_pictures},
        {"lag": 12_000_000},
        {"depth": ""},
    ],
)
def test_bad_input_causes_a_warning_and_no_target(world, look, options):
    node = look(follow="colour", depth_tolerance=0.01)
    targets = world.record("/target_point")
    show(world, **options)
    assert targets == []
    assert node.warnings
    show(world, info=None, depth="16UC1")
    assert targets, "it recovers"


def test_object_size_without_depth(world, look):
    node = look(follow="colour", object_size=0.3)
    targets = world.record("/target_point")
    show(world, depth="")
    assert targets[-1][1].point.z == pytest.approx(0.3 * CAMERA.fx / 59, rel=0.01)
    assert accepts(node, object_size=0.6)
    show(world, depth="", frames=2)
    assert targets[-1][1].point.z == pytest.approx(0.6 * CAMERA.fx / 59, rel=0.01)
    assert not accepts(node, min_distance=50.0)


def test_follow_can_be_changed_also_after_a_detector_that_fails(world, look):
    node = look(follow="marker", net="/nowhere/net.onnx")
    targets = world.record("/target_point")
    for nothing in ("marker", "face"):  # whose detector fails
        assert accepts(node, follow=nothing)
        show(world)
        assert not targets
    assert accepts(node, follow="colour")
    show(world, info=ANY_FRAME)
    assert targets[-1][1].header.frame_id == "camera_optical_frame"
    assert accepts(node, hue_tolerance=1.0)
    assert not accepts(node, follow="nobody")


def test_a_detector_has_the_parameters_that_were_set_before_it_was_chosen(world, look, monkeypatch):
    """Also if another detector has the same parameters."""
    monkeypatch.setitem(DETECTORS, "another one of colours", DETECTORS["colour"])
    node = look()
    assert accepts(node, hue=240.0)
    assert accepts(node, follow="colour")
    wait_for(lambda: getattr(node.tracker.detector.parameters, "hue", None) == 240.0)


def test_selected_boxes(world, look):
    node = look(follow="features", distance=1.0)
    targets = world.record("/target_point")
    world.publish("/visual_target/select", RegionOfInterest(width=10, height=10))
    world.run(0.01)
    assert len(node.warnings) == 1
    show(world, depth="")
    assert not targets
    choice = RegionOfInterest(x_offset=120, y_offset=80, width=80, height=80)
    world.publish("/visual_target/select", choice)
    show(world, depth="")
    assert targets[-1][1].point.z == pytest.approx(1.0, abs=0.01)
    assert accepts(node, follow="colour")
    world.publish("/visual_target/select", choice)
    world.run(0.01)
    assert len(node.warnings) == 2


def test_what_else_is_seen_is_published_and_can_be_selected(world, look):
    node = look(follow="colour", distance=1.0)
    targets = world.record("/target_point")
    others = world.record("/visual_target/others")

    def with_a_smaller_ball(image, _):
        pixels = np.frombuffer(image.data, np.uint8).reshape(240, 320, 3).copy()
        pixels[100:140, 240:280] = (20, 110, 245)
        image.data = pixels.tobytes()

    show(world, depth="", change=with_a_smaller_ball)
    assert abs(targets[-1][1].point.x) < 0.05
    (other,) = others[-1][1].poses
    assert (other.position.x, other.position.z) == pytest.approx((0.3, 0.9), abs=0.2)
    chosen = PointStamped(header=others[-1][1].header, point=other.position)
    far = PointStamped(header=chosen.header, point=Point(x=9.0, y=9.0, z=9.0))
    nowhere = PointStamped(header=header(world.now, "nowhere"), point=other.position)
    for message, warnings in ((chosen, 0), (far, 1), (nowhere, 2)):
        world.publish("/visual_target/select_point", message)
        before = len(targets)
        show(world, depth="", change=with_a_smaller_ball)
        assert len(node.warnings) == warnings
        assert len(targets) == before + 6  # every image: a wrong message costs no track
        assert targets[-1][1].point.x == pytest.approx(other.position.x, abs=0.02)
        assert abs(others[-1][1].poses[0].position.x) < 0.05


def test_the_simulated_camera_shows_the_scene_that_was_chosen_last(world):
    first = Parameter("scene", value="ball")
    eye = SimulatedCameraNode(buffer=world.buffer, parameter_overrides=[first])
    for name in ("marker", "ball"):  # the second one before the first one is drawn
        assert accepts(eye, scene=name)
    time.sleep(0.3)  # for its thread
    assert "ball" in eye.scene
    assert "marker" not in eye.scene
    eye.destroy_node()


@pytest.mark.parametrize("wanted", [(), ("/depth",), ("/image", "/camera_info")])
def test_the_simulated_camera_publishes_only_what_is_subscribed_to(world, wanted, monkeypatch):
    world.make(SimulatedCameraNode, {"scene": "ball", **SMALL}, buffer=world.buffer)
    published = []
    monkeypatch.setattr(
        world, "publish", lambda topic, message: published.append((topic, message.header.stamp))
    )
    for topic in wanted:
        world.listen(topic, lambda _: None)
    world.run(0.3)
    assert {topic for topic, _ in published} == set(wanted)
    stamps = [(stamp.sec, stamp.nanosec) for _, stamp in published]
    assert stamps == sorted(stamps)


# in one process with everything else


def test_the_delivery_of_its_image_is_a_parameter(threads):
    given = {"follow": "colour", "qos_overrides./visual_target/image.publisher.depth": 1}
    look = VisualTargetNode(parameter_overrides=[Parameter(k, value=v) for k, v in given.items()])
    assert {name: look.get_parameter(name).value for name in given} == given
    look.destroy_node()


def test_detection_does_not_block_the_executor(threads):
    """All nodes share one executor: what takes long is done beside it."""
    look = VisualTargetNode(parameter_overrides=[Parameter("follow", value="colour")])
    go, looked = threading.Event(), []

    class Slow:
        parameters = None

        def detect(self, frame, hints):
            looked.append(frame.stamp)
            assert go.wait(PATIENCE)
            return []

    look.tracker.detector = Slow()
    look._on_info(camera_info(header(1, "c"), CAMERA))
    for stamp in (1, 2, 3):
        look._on_image(image_message(header(stamp, "c"), "bgr8", np.zeros((240, 320, 3), "u1")))
        wait_for(lambda: looked)
    ticks = []
    look.create_timer(0.001, lambda: ticks.append(len(looked)))
    threads.start(look)
    wait_for(lambda: len(ticks) >= 5)
    assert ticks[:5] == [1] * 5, "the executor goes on while an image is looked at"
    go.set()
    wait_for(lambda: looked == [1, 3])
    look.destroy_node()
    assert "visual_target" not in {thread.name for thread in threading.enumerate()}
