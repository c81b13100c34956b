"""`Head.follow_camera`: what a camera sees is followed until the next command."""

import math
import time
from functools import partial

import numpy as np
import pytest
from rig import DEGREE, run_python
from waiting import PATIENCE, wait_for

from head_tracking import FrameError, HeadState, RefusedCommandError, SupersededError, TargetState
from head_tracking.vision import (
    DETECTORS,
    Box,
    ColourDetector,
    ColourParameters,
    Detector,
    DistanceParameters,
    FaceParameters,
    Frame,
    ImageError,
    NoPictureError,
    Picture,
    camera_with_view,
)

pytest.importorskip("cv2")
GREY = np.full((240, 320, 3), 128, np.uint8)


@pytest.fixture
def follow(head):
    """Follow the face of a drawn room."""
    from head_tracking.scene import film

    where = partial(head.pose, "camera_optical_frame", "base_link")
    return lambda: head.follow_camera("face", film("face", lambda t: where(stamp=t)))


def follows(head):  # as well as on a busy machine
    state, error = head.state, head.error
    return state is TargetState.TRACKING and error is not None and error < 8 * DEGREE


def test_a_face_is_followed_by_the_second_of_two_cameras(head, follow):
    first, camera = follow(), follow()
    assert first.wait(PATIENCE)
    assert isinstance(first.error, SupersededError)
    wait_for(lambda: follows(head))
    assert camera.sighting.confidence > 0.0
    camera.close()
    assert camera.wait(PATIENCE)
    assert camera.error is None


def test_stop_ends_following_and_resume_does_not_restart_it(head, servos, follow):
    camera = follow()
    wait_for(lambda: follows(head))
    wait_for(lambda: not any(head.stop().values()))
    head.resume()
    assert camera.wait(PATIENCE)
    assert isinstance(camera.error, RefusedCommandError)
    rest = servos.at_rest()
    time.sleep(0.5)
    assert servos.true == pytest.approx(rest, abs=0.01)
    assert head.state is HeadState.HOLDING
    follow()
    wait_for(lambda: follows(head))


def grey_images():
    """See nothing, for ever."""
    while True:
        time.sleep(0.02)
        yield time.time(), GREY


def test_another_detector_gets_the_images_of_the_same_camera(head):
    camera = grey_images()
    head.follow_camera("face", camera)
    second = head.follow_camera("colour", camera)
    assert not second.wait(0.5)
    head.hold()
    assert second.wait(PATIENCE)
    assert isinstance(second.error, SupersededError)


@pytest.mark.parametrize(
    ("command", "error"),
    [
        (lambda head: head.hold(), SupersededError),
        (lambda head: head.look_at((1.0, -1.0, 0.6)), SupersededError),
        (lambda head: head.follow((1.0, -1.0, 0.6)), SupersededError),
        (lambda head: head.follow_camera("face", []), SupersededError),
        (lambda head: (head.relax(), head.resume()), SupersededError),
        (lambda head: head.stop(), RefusedCommandError),
        (lambda head: head.close(), RefusedCommandError),
    ],
)
def test_the_next_command_ends_following_also_if_nothing_was_seen(head, command, error):
    released = []

    def images():
        try:
            yield from grey_images()
        finally:
            released.append(True)

    camera = head.follow_camera("face", images())
    command(head)
    assert camera.wait(PATIENCE)
    assert released  # the next one may use the same device
    assert isinstance(camera.error, error)


def test_a_simulated_camera_that_fails_with_its_head_gives_no_warning(head, caplog):
    """Its images need poses of the head, which has ended."""

    def film():
        yield time.time(), GREY
        wait_for(lambda: head.state is HeadState.CLOSED)
        raise FrameError("base_link", "the head is closed")

    camera = head.follow_camera("face", film())
    head.close()
    assert camera.wait(PATIENCE)
    assert isinstance(camera.error, RefusedCommandError)
    assert not caplog.records


def test_images_from_before_the_head_was_opened_do_not_end_following(head):
    """Such as the first ones of a camera in the network."""

    def images():
        yield time.time() - 30.0, GREY
        yield from grey_images()

    camera = head.follow_camera("face", images())
    assert not camera.wait(0.5)
    head.hold()
    assert camera.wait(PATIENCE)
    assert isinstance(camera.error, SupersededError)


def test_a_camera_without_a_face_does_not_move_the_head(head, servos):
    camera = head.follow_camera("face", ((time.time(), GREY) for _ in range(5)))
    assert camera.wait(PATIENCE)
    assert (camera.sighting, camera.error) == (None, None)
    assert servos.true == pytest.approx((0.0, 0.0), abs=1e-6)


def test_invalid_cameras_and_detectors_are_refused(head):
    with pytest.raises(ValueError):
        head.follow_camera("cat")
    with pytest.raises(ValueError, match="distance is -1"):
        head.follow_camera("face", [], distances=DistanceParameters(distance=-1.0))
    with pytest.raises(FrameError):
        head.follow_camera("face", frame="nowhere")
    for what, options in (
        ("face", {"camera": None}), ("face", {"camera": 1.5}),
        ("face", {"camera": True}), (None, {}), (print, {}),
        ("face", {"camera": [], "model": 60.0}), ("face", {"camera": [], "distances": 2.0}),
    ):  # fmt: skip
        with pytest.raises(TypeError):
            head.follow_camera(what, **options)
    for value in ("red", 400.0, math.nan):
        with pytest.raises(ValueError, match="hue"):
            head.follow_camera(ColourDetector(ColourParameters(hue=value)), [])
    for parameters in (FaceParameters(), None):
        with pytest.raises(TypeError, match="ColourParameters"):
            head.follow_camera(ColourDetector(parameters), [])
    head.stop()
    with pytest.raises(RefusedCommandError):
        head.follow_camera("face")


def test_a_detector_without_a_selection_is_reported(head, caplog):
    detector = DETECTORS["features"].make()
    noise = np.random.default_rng(0).integers(0, 255, GREY.shape, np.uint8)
    camera = camera_with_view(noise.shape[1], noise.shape[0], 1.0)
    for expected in (1, 0):
        caplog.clear()
        head.follow_camera(detector, [])
        assert sum("select" in record.getMessage() for record in caplog.records) == expected
        detector.select(Frame(1, camera, Picture(noise)), Box(10, 10, 60, 60))


def unplugged():
    raise OSError
    yield


@pytest.mark.parametrize(
    ("camera", "error"),
    [
        ("/nowhere/none.mp4", NoPictureError),
        (-1, NoPictureError),  # OpenCV 4 and 5 end the process if there is no camera
        (unplugged(), OSError),
        ([(float("nan"), GREY)], ImageError),
        ([(1.0, GREY)], FrameError),  # the time of another clock
        ([GREY], ImageError),
        ([(GREY, 1.0)], ImageError),
    ],
)
def test_a_failing_camera_ends_following_with_its_error_and_a_warning(head, camera, error, caplog):
    following = head.follow_camera("face", camera)
    assert following.wait(PATIENCE)
    assert isinstance(following.error, error)
    assert sum("camera" in record.name for record in caplog.records) == 1


def test_an_error_in_a_detector_is_logged_with_its_kind_and_its_traceback(head, caplog):
    class Wrong(Detector):
        def detect(self, frame, hints):
            return {}["missing"]

    following = head.follow_camera(Wrong(None), grey_images())
    assert following.wait(PATIENCE)
    (record,) = (record for record in caplog.records if "camera" in record.name)
    assert "KeyError" in record.getMessage() and record.exc_info


def test_an_invalid_picture_ends_following_and_calibration_with_an_error(head):
    for picture in (np.zeros((0, 0, 3), np.uint8), GREY[:, :, 0], GREY / 255, "text", None):
        camera = head.follow_camera("face", iter([(time.time(), picture)]))
        assert camera.wait(PATIENCE)
        assert isinstance(camera.error, ImageError)
        with pytest.raises(ImageError):
            head.calibrate([(time.time(), picture)], target="room")
    assert head.look_at((1.0, 0.2, 0.6)).arrived


BUSY = """
import itertools, time
import cv2, numpy as np
from head_tracking import Head
from head_tracking.vision import Detector

class Busy(Detector):
    def detect(self, frame, hints):
        end = time.monotonic() + 0.5
        while time.monotonic() < end:
            cv2.GaussianBlur(grey, (31, 31), 0.0)
        return []

grey = np.full((480, 640, 3), 128, np.uint8)
with Head.simulated() as head:
    head.follow_camera(Busy(None), ((time.time(), grey) for _ in itertools.count()))
    time.sleep(0.6)
    if {stops}:
        head.stop()
"""


@pytest.mark.parametrize("stops", [False, True])
def test_a_program_ends_while_its_detector_works(stops):
    """OpenCV aborts a process that ends while a thread is in it."""
    done = run_python("-c", BUSY.format(stops=stops))
    assert done.returncode == 0, done.stderr
