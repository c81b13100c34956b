"""The head looks around a marker by itself, with a simulated camera that is mounted wrong."""

import math
import signal
import sys
import time
from collections import deque
from dataclasses import replace
from itertools import islice

import cv2
import numpy as np
import pytest
from random_head import RESIDUALS

from head_tracking import Head, HeadState, RefusedCommandError
from head_tracking.calibration import Calibration, gathering
from head_tracking.calibration.gathering import calibrate_camera
from head_tracking.calibration.geometry import HeadGeometry
from head_tracking.calibration.solver import CalibrationError, Reason, View
from head_tracking.cli import calibrate
from head_tracking.command_line import DONE, FAILED, REFUSED
from head_tracking.configuration import configured_head
from head_tracking.configuration.simulated import mounted_servos
from head_tracking.exceptions import (
    FrameError,
    HeadTrackingError,
    SupersededError,
    UnreachableError,
)
from head_tracking.gaze import PanTiltHead
from head_tracking.scene import film
from head_tracking.scene.drawings import marker as drawn_marker
from head_tracking.share import robot_file
from head_tracking.simulation import SimulatedPort
from head_tracking.transforms import RobotModel, TransformBuffer, load_robot_model
from head_tracking.vision import MarkerParameters, camera_with_view
from head_tracking.vision.camera_follower import DEFAULT_VIEW


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(gathering, "LONGEST", 250.0)  # a busy machine needs longer
    monkeypatch.setattr(gathering, "MOST_VIEWS", 13)
    monkeypatch.setattr(gathering, "_SETTLING", 0.15)
    monkeypatch.setattr(gathering, "_SPEED", 2.0)


@pytest.fixture
def unsolved(monkeypatch):
    """Return the list of the views of a short calibration that is not computed."""
    views = []

    def record(geometry, camera, found, *_, **__):
        views.extend(found)
        return Calibration.of(geometry, np.zeros(12), {}, 0.3, len(found), 0, RESIDUALS)

    monkeypatch.setattr(gathering, "LONGEST", 250.0)
    monkeypatch.setattr(gathering, "MOST_VIEWS", 6)
    monkeypatch.setattr(gathering, "solve", record)
    return views


@pytest.mark.parametrize(
    ("target", "views", "degrees"),
    [("marker", 13, 1.0), ("face", 13, 2.0), ("room", 25, 1.0)],  # the step of the encoders is 0.3
)
def test_a_wrong_mounting_is_corrected(quick, monkeypatch, tmp_path, target, views, degrees):
    monkeypatch.setattr(gathering, "MOST_VIEWS", views)
    output, picture = tmp_path / "camera.yaml", tmp_path / "camera.png"
    arguments = ["camera", "--sim", "--yes", "--target", target, "--output", str(output)]
    assert calibrate.main([*arguments, "--picture", str(picture)]) == DONE
    model = load_robot_model(robot_file("kinectbot"))
    found = Calibration.load(output).apply(model).transform("neck_link", "camera_optical_frame", {})
    true = model.transform("neck_link", "camera_optical_frame", {}) @ calibrate.SIMULATED_MOUNTING
    apart, calibration = found.inverse() @ true, Calibration.load(output)
    turned = [calibration.estimates[f"camera {name}"] for name in ("pitch", "yaw", "roll")]
    deviation = np.linalg.norm([each.deviation for each in turned])
    assert 2.0 * np.linalg.norm(apart[3:6]) < 3.5 * deviation < 3.5 * np.radians(degrees)
    assert target != "marker" or np.linalg.norm(apart.translation) < 0.009  # m; it was 11 mm
    for name in ("pan play", "tilt play"):
        play = calibration.estimates[name]
        assert abs(play.value - calibrate.SIMULATED_PLAY) < 3.5 * play.deviation < np.radians(1.0)
    assert calibration.views > 8
    assert calibration.error_after < 0.5 * calibration.error_before
    drawn = cv2.imread(str(picture)).astype(int)
    red, green = drawn[..., 2] - drawn[..., 1] > 60, drawn[..., 1] - drawn[..., 2] > 60
    assert red.sum() > 2 * green.sum()


def test_a_simulated_camera_that_is_low_and_cannot_look_up_sees_the_marker(
    quick, unsolved, tmp_path
):
    file = tmp_path / "calibration.yaml"
    words = ["camera", "--sim", "--robot", "poppy", "--yes", "--output", str(file)]
    assert calibrate.main(words) == DONE
    assert Calibration.load(file).robot == "poppy"


def test_the_camera_of_a_model_of_your_own_may_have_another_frame(quick, unsolved, tmp_path):
    file, model = tmp_path / "calibration.yaml", tmp_path / "own.urdf"
    urdf = load_robot_model(robot_file("kinectbot")).urdf
    model.write_text(urdf.replace("camera_optical_frame", "eye").replace("base_link", "torso"))
    words = ["camera", "--sim", "--robot", str(model), "--yes", "--output", str(file)]
    assert calibrate.main(words) == FAILED
    assert calibrate.main([*words, "--frame", "eye"]) == DONE
    assert file.exists()


def test_the_servos_are_those_of_a_parameter_file(monkeypatch, tmp_path):
    """Else a head whose zeros `servo calibrate` has measured turns about others."""
    file, opened = tmp_path / "my_head.yaml", []
    file.write_text("servo_bus: {ros__parameters: {head_pan_controller: {motor: {id: 7}}}}")

    def simulated(*, servos, **_):
        opened.extend(servo.calibrations[0].id for servo in servos)
        raise HeadTrackingError

    monkeypatch.setattr(Head, "simulated", simulated)
    output = str(tmp_path / "calibration.yaml")
    words = ["camera", "--sim", "--yes", "--params", str(file), "--output", output]
    assert calibrate.main(words) == FAILED
    assert opened == [7, 2]


@pytest.mark.parametrize(("command", "step"), [("stop", "direction 3"), ("relax", "computing")])
def test_a_head_that_is_stopped_or_relaxed_is_not_calibrated(quick, unsolved, step, command):
    with Head.simulated() as head:

        def report(text):
            if step in text:
                getattr(head, command)()

        images = calibrate._simulated_images(head, "marker")
        with pytest.raises(RefusedCommandError) as refusal:
            head.calibrate(images, marker=MARKER, report=report)
        assert refusal.value.state == head.state
        assert head.state in (HeadState.STOPPED, HeadState.RELAXED)


@pytest.mark.parametrize(
    ("words", "code"), [([], REFUSED), (["--yes", "--marker-id", "3"], FAILED)]
)
def test_nothing_is_written_without_confirmation_or_marker(tmp_path, words, code):
    output = tmp_path / "camera.yaml"
    assert calibrate.main(["camera", "--sim", "--output", str(output), *words]) == code
    assert not output.exists()


def test_a_signal_ends_it_with_relaxed_servos_and_without_a_file(monkeypatch, tmp_path, capsys):
    output, model = tmp_path / "camera.yaml", load_robot_model(robot_file("kinectbot"))
    camera = model.transform("base_link", "camera_optical_frame", dict.fromkeys(model.joints, 0.0))
    with SimulatedPort(mounted_servos(configured_head(()).servos), paced=True) as servos:

        def images(*_):
            for each in film("still marker", lambda stamp: camera):
                if abs(servos.use(lambda bus: bus[1].true_ticks) - 512) > 10:
                    signal.raise_signal(signal.SIGHUP)
                yield each

        def head(**_):
            return Head(servos.port_name, model, reply_timeout=0.2)

        monkeypatch.setattr(calibrate, "_simulated_images", images)
        monkeypatch.setattr(Head, "simulated", head)
        arguments = ["camera", "--sim", "--yes", "--output", str(output)]
        assert calibrate.main(arguments) == 128 + signal.SIGHUP
        torque = servos.use(lambda bus: [bus[id].register("Torque Enable") for id in (1, 2)])
    assert torque == [0, 0]
    assert capsys.readouterr().err.splitlines()[-1].startswith("calibrate: ")
    assert not output.exists()


class LateHead:
    """A head that turns at once, and whose joints are heard of late, as on a busy computer."""

    def __init__(self, late, **limits):
        self.frames, self._late = TransformBuffer(), late
        self.model = load_robot_model(robot_file("kinectbot"))
        joints = [
            replace(joint, limits=joint.limits.narrowed(-limits[name], limits[name], name))
            if name in limits
            else joint
            for name, joint in self.model.joints.items()
        ]
        self.model = RobotModel(self.model.name, self.model.links, joints)
        self.frames.set_model(self.model)
        self.head = PanTiltHead(self.model, "head_pan_joint", "head_tilt_joint", "camera_link")
        self.true = {"head_pan_joint": 0.0, "head_tilt_joint": 0.0}
        self._reports = deque([(0.0, self.true)])
        self.hear()

    def hear(self):
        """Receive what was measured some time ago."""
        now = time.time()
        self._reports.append((now, self.true))
        while self._reports and self._reports[0][0] <= now - self._late:
            stamp, positions = self._reports.popleft()
            self.frames.set_joint_positions(round(1e9 * stamp), positions)

    @property
    def joints(self):
        self.hear()
        return {name: self.frames.latest_joint_position(name)[1] for name in self.true}

    def hold(self):
        pass

    def look_at(self, point, frame, *, max_velocity):
        gaze = self.head.gaze(point, *self.true.values())
        if not gaze.reached:
            raise UnreachableError(point, frame, gaze.miss, gaze.reason)
        self.true = dict(zip(self.true, (gaze.pan, gaze.tilt), strict=True))

    def film(self, scene="still marker"):
        """Return what its camera sees of a marker."""

        def camera(stamp):
            return self.model.transform("base_link", "camera_optical_frame", self.true)

        return film(scene, camera)


MARKER = MarkerParameters("4X4_50", -1, 0.16)
PLACE = (1.5, 0.2, 0.7)  # m, of the marker in the film


def assert_consistent(model, views):
    """Each view shows the marker where the camera of its joint positions sees it."""
    assert len(views) > 4
    lens = camera_with_view(320, 240, DEFAULT_VIEW)
    for view in views:
        joints = {"head_pan_joint": view.pan, "head_tilt_joint": view.tilt}
        camera = model.transform("base_link", "camera_optical_frame", joints)
        expected = lens.pixel(camera.inverse() @ PLACE)
        assert math.dist(view.corners.mean(axis=0), expected) < 3.0


def test_a_view_counts_only_while_the_joints_stand(quick, unsolved, monkeypatch):
    monkeypatch.setattr(gathering, "_SETTLING", 0.0)
    head = LateHead(0.15)
    calibrate_camera(head, head.film(), marker=MARKER)
    assert_consistent(head.model, unsolved)


def gather(head):
    geometry = HeadGeometry(head.model, *head.true, "camera_optical_frame")
    return gathering._Gathering(head, geometry, iter(()), None, None, "", 1.0)


def test_a_turn_is_repeated_while_the_joints_are_not_measured(monkeypatch):
    head, errors = LateHead(0.0), [FrameError("base_link", "the joints are not measured")] * 2
    turn = head.look_at

    def look_at(*arguments, **options):
        if errors:
            raise errors.pop()
        turn(*arguments, **options)

    monkeypatch.setattr(head, "look_at", look_at)
    monkeypatch.setattr(gathering, "_RETRY", 0.0)
    views = gather(head)
    assert views._turn(PLACE, math.inf)
    assert head.true["head_pan_joint"] > 0.05
    errors.append(FrameError("base_link", "the joints are not measured"))
    with pytest.raises(FrameError):
        views._turn(PLACE, 0.0)
    errors.append(SupersededError(PLACE, None))  # such as a second calibration
    with pytest.raises(CalibrationError):
        views._turn(PLACE, math.inf)


def test_the_direction_of_a_motion_is_known_after_it_has_crossed_the_play():
    """Also if the last part of the motion is heard of later, or the head has turned back."""
    head, directions = LateHead(0.0), []
    views = gather(head)
    for pans in ([0.01], [0.2], [0.22], [0.21], [0.1], [0.09], [0.11], [0.3, 0.28]):
        for pan in pans:
            head.true = {**head.true, "head_pan_joint": pan}
            head.hear()
        views._note_motion()
        directions.append(views._directions[0])
    assert directions == [0, 1, 1, 0, -1, -1, 0, 0]


@pytest.mark.parametrize(("noise", "speed", "found"), [(2.0, 0.0, True), (0.5, 5.0, False)])
def test_noise_of_the_corners_is_no_motion(monkeypatch, noise, speed, found):
    """As in a dark room; none of a hundred pairs of images has four corners within 1 pixel."""
    head, rng, square = LateHead(0.0), np.random.default_rng(3), np.eye(4, 2)
    views, shown, begin = gather(head), iter(range(70)), time.time()

    def detect(stamp, picture):
        corners = square + speed * next(shown) + rng.normal(0.0, noise, (4, 2))
        return {7: View(0.0, 0.0, 7, corners)}

    monkeypatch.setattr(views, "_detect", detect)
    monkeypatch.setattr(views, "_source", ((begin + k / 30.0, None) for k in range(70)))
    monkeypatch.setattr(gathering, "_LATE", 0.0)
    monkeypatch.setattr(head, "hear", lambda: None)
    monkeypatch.setattr(gathering.time, "time", lambda: begin + 3.0)
    assert bool(views._views()) is found


def test_both_joints_turn_between_two_views():
    """A joint that does not turn stays at an unknown place in its play."""
    head, places = LateHead(0.0), []
    views = gather(head)
    views._camera = camera_with_view(320, 240, DEFAULT_VIEW)
    for point in views._points(View(0.0, 0.0, 7, np.array([(160.0, 120.0)]))):
        head.look_at(point, "", max_velocity=1.0)
        places.append([*head.true.values()])
    assert len(places) == 25
    assert np.abs(np.diff(places, axis=0)).min() > gathering._CROSSED


class RestlessHead(LateHead):
    """A head that turns to and fro, by itself or by hand."""

    held = False

    def hold(self):
        self.held = True

    def hear(self):
        if not self.held:
            self.true = {**self.true, "head_pan_joint": 0.1 * math.sin(5.0 * time.time())}
        super().hear()


def test_a_head_that_follows_something_is_held_first(quick, unsolved):
    head = RestlessHead(0.0)
    calibrate_camera(head, islice(head.film(), 400), marker=MARKER)
    assert_consistent(head.model, unsolved)


def test_narrow_limits_are_used_and_what_they_hide_is_named(quick):
    head = LateHead(0.0, head_pan_joint=math.radians(3.0), head_tilt_joint=math.radians(1.0))
    found = calibrate_camera(head, head.film(), marker=MARKER)
    unknown = ("camera ahead", "tilt axis not square", "tilt play")
    assert found.views > 8
    assert not any(found.estimates[name].observable for name in unknown)
    assert found.estimates["pan play"].deviation > math.radians(0.02)
    for value, deviation, observable in found.estimates.values():
        assert not observable or abs(value) < 3.5 * deviation


def test_a_marker_that_moves_is_not_said_to_be_out_of_sight():
    head = LateHead(0.0)
    with pytest.raises(CalibrationError, match=r"a marker .* at rest") as refusal:
        calibrate_camera(head, head.film("marker"), marker=MARKER)
    assert refusal.value.reason is Reason.FEW_VIEWS


def repeat_now(picture):
    while True:
        time.sleep(0.05)
        yield time.time(), picture


def test_images_that_are_missing_or_unusable_and_unknown_markers_are_refused(monkeypatch):
    """A camera with a clock of its own is named, or the error would say that nothing is visible."""
    images = [(time.time(), np.zeros((240, 320, 3), np.uint8)) for _ in range(100)]
    twins = np.full((240, 320, 3), 255, np.uint8)
    twins[40:140, 30:130] = twins[40:140, 180:280] = cv2.resize(
        drawn_marker("4X4_50", 7)[:, :, :3], (100, 100)
    )
    early = [(stamp - 1e6, picture) for stamp, picture in images]
    other = camera_with_view(640, 480, math.radians(60.0))
    with Head.simulated() as head:
        for given, marker, model in (
            (images, MarkerParameters("5", -1, 0.16), None),
            (images, MarkerParameters("4X4_50", 50, 0.16), None),
            (images, MarkerParameters("4X4_50", -1, 160.0), None),  # mm
            (images, MarkerParameters("4X4_50", -1, math.nan), None),
            (images, MarkerParameters("4X4_50", "7", 0.16), None),
            (images, None, None),
            (images, MARKER, other),
            (early, MARKER, None),
        ):
            with pytest.raises(ValueError):
                head.calibrate(iter(given), marker=marker, model=model)
        for wrong in ({"marker": 0.16}, {"marker": MARKER, "model": 60.0}):
            with pytest.raises(TypeError, match="is no"):
                head.calibrate(iter(images), **wrong)
        with pytest.raises(CalibrationError) as refusal:
            head.calibrate([], marker=MARKER)
        assert refusal.value.reason is Reason.NO_PICTURE
        with pytest.raises(CalibrationError) as refusal:
            head.calibrate(repeat_now(twins), marker=MARKER)
        assert refusal.value.reason is Reason.TWO_MARKERS
        monkeypatch.setitem(sys.modules, "scipy", None)
        with pytest.raises(CalibrationError) as refusal:
            head.calibrate([], marker=MARKER)
        assert refusal.value.reason is Reason.NOT_INSTALLED
