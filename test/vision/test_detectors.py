"""Position errors on rendered images: the camera turns, the things move, the truth is known."""

import math

import numpy as np
import pytest
from rendered_frames import KINECT, SMALL, View, drawn, make_tracker, seen_surface, watch

from head_tracking.run.node_sets import TARGETS
from head_tracking.scene import SCENES, Swing
from head_tracking.scene.drawings import marker
from head_tracking.scene.room import room
from head_tracking.scene.scenes import FACE_WIDTH, MARKER_SIZE, marker_board
from head_tracking.vision import (
    DETECTORS,
    Box,
    Camera,
    Candidate,
    DistanceParameters,
    Frame,
    IdentityParameters,
    MarkerParameters,
    Picture,
    VisualTracker,
)

MM = 1e-3


SIZED = {"parameters": MarkerParameters(marker_size=MARKER_SIZE)}


@pytest.mark.parametrize(
    ("what", "name", "depth", "worst", "parameters", "select"),
    [
        ("colour", "ball", "16UC1", 30, {}, 0),
        ("marker", "marker", "32FC1", 8, {}, 0),
        ("face", "face", "16UC1", 10, {}, 0),
        ("features", "picture", "16UC1", 15, {}, 70),
        ("colour", "ball", "", 60, {"object_size": 0.16}, 0),
        ("marker", "marker", "", 25, SIZED, 0),
        ("face", "face", "", 200, {"object_size": FACE_WIDTH}, 0),
        ("face", "face", "", 60, {"distance": 1.4}, 0),
    ],
)
def test_position_error(kinectbot, what, name, depth, worst, parameters, select):
    view = View(drawn(name), kinectbot, KINECT, depth=depth)
    seen = watch(make_tracker(what, **parameters), view, name, 15, select=select, centre=not depth)
    assert len(seen.misses) >= 12
    assert max(seen.misses) < worst * MM, [round(miss / MM) for miss in seen.misses]
    assert len(seen.numbers) == 1


@pytest.mark.parametrize("what", DETECTORS)
def test_one_entry_makes_a_detector_a_target_of_a_run(what):
    spec = DETECTORS[what]
    assert TARGETS[spec.target][0].parameters == {"follow": what}
    assert spec.scene in SCENES


@pytest.mark.parametrize("what", ["face", "colour", "marker"])
def test_an_empty_room_has_no_targets(kinectbot, what):
    view = View(drawn("empty"), kinectbot, SMALL, noise=6.0)
    seen = watch(make_tracker(what), view, "", 15)
    assert seen.sightings == [None] * 15


def still(thing, **others):
    return {**room(), "thing": thing, **others}


# markers


@pytest.mark.parametrize("dictionary", ["4X4_50", "APRILTAG_36h11"])
def test_the_marker_with_the_right_number_is_followed(kinectbot, dictionary):
    three = marker_board(Swing(1.2, 0.6, middle=0.2), 3, dictionary)
    five = marker_board(Swing(1.0, 0.6, middle=-0.2), 5, dictionary)
    view = View(still(three, other=five), kinectbot, KINECT, swing=0.0)
    parameters = MarkerParameters(dictionary=dictionary, marker_id=3)
    seen = watch(make_tracker("marker", parameters), view, "thing", 6)
    assert len(seen.misses) == 4
    assert max(seen.misses) < 10 * MM
    assert seen.sightings[-1].candidate.label == "3"


def test_a_tag_with_a_narrow_border_and_a_wrong_module_is_found():
    tag = marker("APRILTAG_36h11", 3)  # ten modules of 32 pixels, the outer ones white
    tag[64:96, 64:96, :3] ^= 255
    picture = np.full((480, 640, 3), 140, np.uint8)
    picture[80:400, 100:420] = tag[..., :3]
    detector = DETECTORS["marker"].make(MarkerParameters(dictionary="APRILTAG_36h11"))
    found = detector.detect(Frame(0, KINECT, Picture(picture)), [])
    assert [candidate.label for candidate in found] == ["3"]


def test_the_marker_family_can_be_changed(kinectbot):
    view = View(still(marker_board(Swing(1.2, 0.6), 3, "APRILTAG_36h11")), kinectbot, KINECT)
    eye = make_tracker("marker")
    assert not watch(eye, view, "thing", 5).misses
    eye.detector.parameters = MarkerParameters(dictionary="APRILTAG_36h11")
    assert watch(eye, view, "thing", 9).misses


# features


def test_features_are_found_again_after_they_were_out_of_sight(kinectbot):
    here = drawn("picture")
    view = View(here, kinectbot, KINECT)
    eye = make_tracker("features")
    picture = here["picture"]
    shown = []
    for i, (time, frame, pose) in enumerate(view.frames(50)):
        if i == 0:
            eye.select(frame, view.box("picture", time, 70))
        sighting = eye.step(frame, pose)
        shown.append(sighting is not None)
        if sighting is not None:
            truth = seen_surface(here, "picture", time, pose)
            assert math.dist(pose @ sighting.point, truth) < 40 * MM
        if i == 19:
            del here["picture"]
        if i == 29:
            here["picture"] = picture
    assert all(shown[3:20])
    assert not any(shown[20:30]), "silence while it is away"
    assert all(shown[34:])


def test_the_search_for_a_small_object_enlarges_no_image(monkeypatch):
    cv2 = pytest.importorskip("cv2")
    rng, sizes, compare = np.random.default_rng(1), [], cv2.matchTemplate
    monkeypatch.setattr(
        cv2, "matchTemplate", lambda image, *more: sizes.append(image.size) or compare(image, *more)
    )
    eye = make_tracker("features", distance=1.0)
    first, second = (
        Frame(i, SMALL, Picture(rng.integers(0, 255, (240, 320, 3), np.uint8))) for i in (1, 2)
    )
    eye.select(first, Box(100, 100, 8, 8))
    eye.step(second)
    assert 0 < max(sizes) <= 240 * 320


@pytest.mark.parametrize(
    "box", [Box(20, 20, 40, 40), Box(0, 0, 0, 0), Box(-50, -50, 20, 20), Box(10, 10, 3, 3)]
)
def test_a_rectangle_without_features_is_not_followed(box):
    eye = make_tracker("features", distance=1.0)
    for i in range(4):
        frame = Frame(i * 33_000_000, SMALL, Picture(np.full((240, 320, 3), 90, np.uint8)))
        if i == 0:
            eye.select(frame, box)
        assert eye.step(frame) is None


# faces and blobs


@pytest.mark.parametrize(
    ("model", "distortion"),
    [("plumb_bob", (-0.28, 0.07, 1e-3, -5e-4, 0.0)), ("equidistant", (-0.02, 0.005, 0.0, 0.0))],
)
def test_hints_include_the_distortion(model, distortion):
    k = [300.0, 0.0, 320.0, 0.0, 300.0, 240.0, 0.0, 0.0, 1.0]
    camera = Camera.from_calibration((640, 480), k, distortion, model)
    hints, box = [], Box(20, 30, 40, 40)

    class Corner:
        parameters = None

        def detect(self, frame, near):
            hints.append(list(near))
            return [Candidate(box, box.centre, 1.0)]

    eye = VisualTracker(Corner(), DistanceParameters(distance=2.0), IdentityParameters())
    for i in range(4):
        eye.step(Frame(i * 33_000_000, camera, Picture(np.zeros((480, 640, 3), np.uint8))))
    assert hints[-1][0] == pytest.approx(box, abs=0.5)
