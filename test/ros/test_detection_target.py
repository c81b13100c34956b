"""detection_target over real topics with the real messages of other packages."""

import math
from functools import partial

import numpy as np
import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from waiting import wait_for

from head_tracking.ros.kit.images import camera_info, image_message
from head_tracking.ros.targets.detection_target import DetectionTargetNode
from head_tracking.tf.messages import header
from head_tracking.transforms import Rotation, Transform
from head_tracking.vision import camera_with_view

vision = pytest.importorskip("vision_msgs.msg")
hri = pytest.importorskip("hri_msgs.msg")
pytest.importorskip("cv2", reason="needs OpenCV: pip install -r requirements/vision.txt")

CAMERA = camera_with_view(320, 240, 1.0)


class Scene:
    """Another program that finds things, and somebody who listens for the target."""

    def __init__(self, world, **parameters):
        self.world = world
        parameters = {"fixed_frame": "", **parameters}
        self.node = world.make(DetectionTargetNode, parameters, buffer=world.buffer)
        self._targets = world.record("/target_point")
        self._ids = world.record("/detection_target/id")

    @property
    def ids(self):
        return {message.data for _, message in self._ids}

    def publish(self, topic, message):
        self.world.publish(topic, message)
        self.world.run(0.002)

    def show(self, make, images=6, depth=None):
        """What is found in some images, one after the other; the targets that came of it."""
        before = len(self._targets)
        for _ in range(images):
            head = header(self.world.now, "camera")
            self.publish("/camera_info", camera_info(head, CAMERA))
            if depth is not None:
                self.publish("/depth", image_message(head, "32FC1", depth))
            for topic, message in make(head):
                self.publish(topic, message)
            self.world.run(1 / 30)
        return [message for _, message in self._targets[before:]]


@pytest.fixture
def scene(world):
    return partial(Scene, world)


def detection(name, u, v, width, *, score=0.9, kind="person"):
    found = vision.Detection2D(id=name)
    found.bbox.center.position.x, found.bbox.center.position.y = float(u), float(v)
    found.bbox.size_x = found.bbox.size_y = float(width)
    result = vision.ObjectHypothesisWithPose()
    result.hypothesis.class_id, result.hypothesis.score = kind, score
    found.results = [result]
    return found


def array(*detections):
    return lambda head: [
        ("/detections", vision.Detection2DArray(header=head, detections=list(detections)))
    ]


def point(message):
    return message.point.x, message.point.y, message.point.z


def test_position_of_a_detection_with_depth(scene):
    depth = np.full((240, 320), 4.0, np.float32)
    depth[80:160, 40:120] = 1.5
    world = scene()
    found = world.show(array(detection("a", 79.5, 119.5, 60)), depth=depth)
    assert len(found) == 4, "believed from the third image on"
    expected = CAMERA.point((79.5, 119.5), 1.5)
    assert point(found[-1]) == pytest.approx(expected, abs=1e-3)
    assert found[-1].header.frame_id == "camera"


def test_a_detection_with_an_id_is_followed_everywhere(scene):
    """The larger one is followed, and still so when the other one is larger, or it jumps."""
    world = scene(distance=2.0)
    world.show(array(detection("a", 80, 80, 60), detection("b", 240, 80, 40)))
    world.show(array(detection("a", 80, 80, 30), detection("b", 240, 80, 60)))
    silence = world.show(array(detection("b", 240, 80, 60)))
    assert silence == []
    jumped = world.show(array(detection("a", 160, 200, 30), detection("b", 80, 80, 60)), images=2)
    assert len(jumped) == 2
    assert jumped[-1].point.y > 0.3
    assert world.ids == {"a"}


def test_an_object_keeps_its_track_while_its_id_changes(scene):
    world = scene(distance=2.0)
    found = [world.show(array(detection(name, 80, 80, 60)), images=1) for name in "abcdef"]
    assert len(found[-1]) == 1


def test_an_id_of_two_objects_does_not_identify_them(scene):
    """Such as the number of their class."""
    world, one, other = scene(distance=2.0), detection("0", 80, 80, 60), detection("0", 240, 80, 60)
    world.show(array(one, other))
    found = world.show(array(one, other)) + world.show(array(other, one))
    assert len({message.point.x > 0.0 for message in found}) == 1


def test_other_classes_and_invalid_detections_are_ignored(scene):
    world = scene(distance=2.0, class_id="person")
    found = world.show(
        array(
            detection("dog", 80, 80, 90, kind="dog"),
            detection("nan", math.nan, 80, 90),
            detection("empty", 80, 80, 0),
            detection("me", 240, 80, 40),
        ),
    )
    assert len(found) == 4
    assert world.ids == {"me"}
    assert found[-1].point.x > 0


@pytest.mark.parametrize(("score", "column"), [(0.1, 240), (0.9, 240), (0.9, 400)])
def test_why_what_is_seen_is_not_published(scene, monkeypatch, score, column):
    world, warnings = scene(distance=2.0), []
    monkeypatch.setattr(world.node, "warn", warnings.append)
    for each in (0.9, score):
        found = world.show(array(detection("me", column, 80, 40, score=each)), images=20)
    assert bool(warnings) == (not found[10:]) == (score < 0.3 or column > CAMERA.width)


def test_detections_of_other_classes_are_named_until_one_is_of_the_class(scene, monkeypatch):
    world, warnings, named = scene(distance=2.0, class_id="person"), [], []
    monkeypatch.setattr(world.node, "warn", warnings.append)
    for kind in ("0", "person", "0"):
        warnings.clear()
        world.show(array(detection("me", 240, 80, 40, kind=kind)))
        named.append(bool(warnings))
    assert named == [True, False, False]


def test_detections_in_space(scene):
    world = scene(source="detections_3d")

    def found(head):
        message = vision.Detection3DArray(header=head)
        message.header.frame_id = "lidar"
        damaged = ("huge", 1e200), ("infinite", math.inf), ("none", math.nan)
        for name, x in (("far", 5.0), ("near", 2.0), *damaged):
            one = vision.Detection3D(id=name)
            one.bbox.center.position.x, one.bbox.center.position.y = x, 0.5
            one.bbox.size.x = one.bbox.size.y = one.bbox.size.z = 0.5
            message.detections.append(one)
        return [("/detections", message)]

    message = world.show(found)[-1]
    assert (message.header.frame_id, point(message)) == ("lidar", (2.0, 0.5, 0.0))


@pytest.mark.parametrize("source", ["faces", "bodies"])
def test_faces_and_bodies_of_ros4hri_are_followed_by_their_ids(scene, source):
    world = scene(source=source, distance=2.0)

    def people(names):
        def make(head):
            messages = [(f"/humans/{source}/tracked", hri.IdsList(header=head, ids=names))]
            for i, name in enumerate(names):
                region = hri.NormalizedRegionOfInterest2D(header=head, ymin=0.4, ymax=0.6, c=0.9)
                region.xmin, region.xmax = 0.2 + 0.4 * i, 0.4 + 0.4 * i - 0.05 * i
                messages.append((f"/humans/{source}/{name}/roi", region))
            return messages

        return make

    found = world.show(people(["abc", "xyz"]))
    assert found[-1].point.x == pytest.approx(2.0 * math.sin(-0.21), abs=0.03)
    assert world.ids == {"abc"}
    assert world.show(people(["xyz"])) == [], "the other one is not taken at once"
    world.show(lambda head: [(f"/humans/{source}/tracked", hri.IdsList(header=head))])
    assert world.world.listeners(f"/humans/{source}/xyz/roi") == 0


def test_an_id_that_no_topic_can_have_costs_that_id_only(start):
    robot = start(Node("robot"))
    tracked = robot.create_publisher(hri.IdsList, "/humans/faces/tracked", 10)
    start(DetectionTargetNode(parameter_overrides=[Parameter("source", value="faces")]))

    def hears_the_other():
        for name in ("a b", "1x", "", "3f2a-91"):
            tracked.publish(hri.IdsList(ids=[name]))
        tracked.publish(hri.IdsList(ids=["abc"]))
        return robot.count_subscribers("/humans/faces/abc/roi")

    wait_for(hears_the_other)


def test_a_face_with_a_frame_is_taken_from_there(scene):
    world = scene(source="faces")
    at = Transform((0.1, 0.2, 1.25), Rotation.identity())
    for later in (0, 10**9):
        world.world.buffer.core.set_transform(world.world.now + later, "camera", "face_abc", at)

    def face(head):
        region = hri.NormalizedRegionOfInterest2D(header=head, xmin=0.4, xmax=0.6, ymax=0.3)
        tracked = hri.IdsList(header=head, ids=["abc"])
        return [("/humans/faces/tracked", tracked), ("/humans/faces/abc/roi", region)]

    found = world.show(face)
    assert point(found[-1]) == pytest.approx((0.1, 0.2, 1.25))
