"""What the page asks of the robot, over real topics and the simulated bus; without a browser."""

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped
from rig import DEGREE, bearing
from robot_under_test import Robot
from viewing import view
from waiting import PATIENCE, wait_for

from head_tracking.calibration import Calibration, gathering
from head_tracking.exceptions import HeadTrackingError
from head_tracking.page.calibrating import CameraCalibration, _PointedHead
from head_tracking.page.head_modes import Mode
from head_tracking.page.other_topics import image_of
from head_tracking.page.path import ClosedPath
from head_tracking.page.status import Word
from head_tracking.page.viewer import ViewerNode
from head_tracking.ros.kit.diagnostics import Level, Part
from head_tracking.ros.kit.target_point import target_from_message
from head_tracking.run.node_sets import CAMERA
from head_tracking.run.options import parse_arguments
from head_tracking.tracking import Target
from head_tracking.transforms import Rotation, Transform


@pytest.fixture(scope="module")
def robot(make_module_robot):
    return make_module_robot("--target", "none", "--viewer")


@pytest.fixture(scope="module")
def page(robot):
    """The robot as the page sees it, once it has found out what is there."""
    seen = view(robot.threads, alone=False).robot
    wait_for(lambda: seen.modes.mode() is Mode.TRACK and len(seen.joints.servos()) == 2)
    wait_for(lambda: any(setting.name == "k_pan" for setting in seen.parameters.settings()))
    return seen


@pytest.fixture
def seen(robot, page):
    """The same, tracking nothing with the head in the middle, whatever the test before has left."""
    if page.stop.can_resume:
        page.stop.resume()
        wait_for(lambda: not page.stop.can_resume)
    page.modes.set_mode(Mode.TRACK)
    page.modes.centre()
    wait_for(lambda: page.modes.mode() is Mode.TRACK and head_is_at(robot, 0.0))
    return page


@pytest.fixture(scope="module")
def camera(robot):
    pytest.importorskip("cv2", reason="needs OpenCV: pip install -r requirements/vision.txt")
    robot.threads.start(CAMERA.make({"buffer": robot.composition.buffer}))


def head_is_at(robot: Robot, pan: float) -> bool:
    return abs(robot.true("head_pan_joint") - pan) < 2 * DEGREE


def test_modes_start_the_nodes_they_need_and_only_one_turns_the_head(robot, seen):
    assert "point_head" not in robot.composition.nodes
    assert not seen.has_camera
    seen.modes.set_mode(Mode.POINT, "")
    assert "point_head" in robot.composition.nodes
    wait_for(lambda: robot.node.count_subscribers("target_point") >= 3)
    seen.modes.look_at("base_link", (1.0, -0.6, 0.4))
    wait_for(lambda: head_is_at(robot, bearing(1.0, -0.6)))
    seen.modes.set_mode(Mode.FICTITIOUS, "")
    # at once: a node that was only just started must be switched off too
    seen.modes.look_at("base_link", (1.0, 0.6, 0.4))
    assert seen.modes.mode() is Mode.TRACK
    wait_for(lambda: head_is_at(robot, bearing(1.0, 0.6)))
    robot.at_rest(1.0)
    assert head_is_at(robot, bearing(1.0, 0.6))
    seen.modes.set_mode(Mode.FICTITIOUS, "")
    assert seen.modes.mode() is Mode.FICTITIOUS
    wait_for(lambda: robot.true("head_pan_joint") < 0.0)


def test_a_frame_is_followed_until_nothing_comes_of_it_any_more(robot, seen):
    core = seen.buffer

    def word_while_seen(y=-0.5):
        now = robot.node.get_clock().now().nanoseconds
        place = Transform((1.0, y, 0.5), Rotation.identity())
        core.set_transform(now, "base_link", "person_1", place)
        return seen.status(seen.observe()).word

    word_while_seen()
    seen.modes.set_mode(Mode.FOLLOW)
    assert seen.modes.mode() is Mode.FOLLOW
    wait_for(lambda: seen.observe().target is None)  # no frame has been chosen
    seen.modes.set_mode(Mode.FOLLOW, "person_1")
    for y in (0.5, -0.5):
        wait_for(
            lambda y=y: word_while_seen(y) is Word.ON_TARGET and head_is_at(robot, bearing(1.0, y))
        )
    wait_for(lambda: seen.status(seen.observe()).word is Word.HOLDING)
    assert head_is_at(robot, bearing(1.0, -0.5))


def test_the_head_looks_along_a_path_at_its_speed(robot, seen):
    with pytest.raises(HeadTrackingError):
        seen.modes.set_mode(Mode.PATH)
    ends = (1.0, 0.4, 0.5), (1.0, -0.4, 0.5)
    root = seen.model().root
    to_base = robot.composition.buffer.core.lookup_transform("base_link", root).transform
    seen.modes.follow_path(ClosedPath(ends), 0.8)
    assert seen.modes.mode() is Mode.PATH
    pans = []

    def swings():
        pans.append(robot.true("head_pan_joint"))
        return max(pans) > bearing(1.0, 0.3) and min(pans) < bearing(1.0, -0.3)

    wait_for(swings)
    x, y, z = to_base @ seen.observe().target
    assert (x, z) == pytest.approx(((to_base @ ends[0])[0], (to_base @ ends[0])[2]), abs=1e-6)
    assert abs(y) <= 0.4 + 1e-6
    seen.modes.set_mode(Mode.FICTITIOUS)
    assert seen.stop.begin().wait(PATIENCE).done
    wait_for(lambda: seen.stop.stopped and not seen.topics.enabled("head_tracker"))
    assert seen.modes.mode() is Mode.FICTITIOUS  # which `resume` would go on with
    seen.modes.set_mode(Mode.OFF)
    assert seen.modes.mode() is Mode.OFF
    seen.stop.resume()
    wait_for(lambda: not seen.stop.stopped)
    assert set(seen.stop.owners.values()) == {""}
    assert seen.modes.mode() is Mode.OFF


def test_an_unknown_frame_is_refused(seen):
    with pytest.raises(HeadTrackingError):
        seen.modes.look_at("nowhere", (1.0, 0.0, 0.0))
    with pytest.raises(HeadTrackingError):
        seen.modes.set_mode(Mode.FOLLOW, "nowhere")


def test_a_refused_point_is_not_shown_as_the_target_of_the_head(robot, seen):
    seen.modes.set_mode(Mode.POINT)
    wait_for(lambda: seen.modes.mode() is Mode.POINT)
    for y in (0.3, -0.3):
        seen.modes.look_at("base_link", (1.0, y, 0.5))
        wait_for(lambda y=y: (seen.observe().target or (0.0, 0.0))[1] == pytest.approx(y))
        for refused in ((-1.0, 0.0, 0.5), (-1.0, 0.1, 0.5)):
            seen.modes.look_at("base_link", refused)
            wait_for(lambda: seen.status(seen.observe()).word is Word.REFUSED)
            assert seen.observe().target is None


def test_the_page_shows_the_target_as_the_camera_sees_it_and_subscribes_only_then(
    robot, seen, camera
):
    seen.modes.look_at("base_link", (1.0, 0.0, 0.5))
    wait_for(lambda: "/image" in seen.topics.images())
    assert robot.node.count_subscribers("/image/compressed") == 0

    def ball():
        picture = seen.topics.picture("/image")
        if picture is None:
            return False
        # a ball of 6 cm at 1 m, in a picture with 586 pixels per rad: a head that looks at it
        middle = np.asarray(image_of(picture.message)).astype(int)[140:340, 220:420]
        r, g, b = (middle[..., channel] for channel in range(3))
        return np.count_nonzero((r > g + 60) & (b > g + 60)) > 1200  # magenta

    wait_for(ball)
    wait_for(lambda: robot.node.count_subscribers("/image/compressed") == 0)


def test_what_the_camera_finds_is_followed_and_a_simulated_room_has_it(robot, seen, camera):
    assert Mode.FACE in seen.modes.possible()
    selected, place = robot.hear("visual_target/select_point", PointStamped), (0.3, 0.1, 2.0)
    with pytest.raises(HeadTrackingError):
        seen.modes.select(Target(1, "camera_optical_frame", place))
    for mode, follows in ((Mode.BALL, "colour"), (Mode.MARKER, "marker")):
        seen.modes.set_mode(mode)
        wait_for(lambda mode=mode: seen.modes.mode() is mode)
        follow = robot.composition.nodes["visual_target"].get_parameter("follow")
        assert follow.value == follows
    wait_for(lambda: seen.observe().target is not None)
    assert seen.has_camera
    assert not seen.modes.conflict()
    seen.modes.select(Target(1, "camera_optical_frame", place))
    wait_for(lambda: selected)
    assert target_from_message(selected[-1]).point == place
    seen.modes.centre()
    assert seen.modes.mode() is Mode.MARKER
    seen.modes.look_at("base_link", (1.0, 0.4, 0.4))
    wait_for(lambda: seen.modes.mode() is Mode.TRACK)


def test_the_viewer_says_what_it_needs(monkeypatch, capsys):
    monkeypatch.setattr("head_tracking.run.options.installed", lambda: False)
    with pytest.raises(SystemExit) as ended:
        parse_arguments(["--sim", "--viewer"])
    assert ended.value.code == 2
    assert "pip install 'head_tracking[page]'" in capsys.readouterr().err
    monkeypatch.setattr("head_tracking.page.viewer.installed", lambda: False)
    with pytest.raises(HeadTrackingError, match="pip install"):
        ViewerNode()


# calibration of the camera


@pytest.fixture
def calibration(camera, seen, monkeypatch, tmp_path):
    """A short calibration, with the head in the middle, where it sees the marker."""
    wait_for(lambda: seen.modes.value("simulated_camera", "scene") is not None)
    seen.modes.set_value("simulated_camera", "scene", "still marker")
    wait_for(lambda: seen.topics.picture("/image") is not None)
    monkeypatch.setattr(gathering, "LONGEST", 250.0)  # a busy machine needs longer
    monkeypatch.setattr(gathering, "MOST_VIEWS", 10)
    monkeypatch.setattr(gathering, "_SETTLING", 0.2)
    monkeypatch.setattr(gathering, "_SPEED", 3.0)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return CameraCalibration(seen, lambda _: seen.topics.picture("/image"))


def ended(calibration: CameraCalibration) -> bool:
    return not calibration.progress.runs


def test_what_is_wrong_is_refused_before_the_head_moves(seen, calibration, tmp_path, monkeypatch):
    """A marker without a size, a file that cannot be written, a model that is calibrated."""
    moved = []
    monkeypatch.setattr(_PointedHead, "hold", moved.append)
    for size in (0.0, float("nan")):
        calibration.begin(size, "")
        wait_for(lambda: ended(calibration))
        assert "marker_size" in calibration.progress.text
    (tmp_path / "head_tracking" / "calibration" / "kinectbot.yaml").mkdir(parents=True)
    calibration.begin(0.16, "")
    wait_for(lambda: ended(calibration))
    assert "kinectbot.yaml" in calibration.progress.text
    used = Part("robot_state_publisher: calibration", Level.OK, "3 days old", ())
    monkeypatch.setattr(seen.topics, "health", lambda: (used,))
    with pytest.raises(HeadTrackingError):
        calibration.begin(0.16, "")
    assert ended(calibration)
    assert not moved


def test_the_head_looks_around_and_writes_what_it_has_measured(robot, seen, calibration, tmp_path):
    usual = seen.modes.value("point_head", "max_velocity")
    calibration.begin(0.16, "")
    with pytest.raises(HeadTrackingError):
        calibration.begin(0.16, "")
    wait_for(lambda: ended(calibration))
    (file,) = tmp_path.rglob("*.yaml")
    assert str(file) in calibration.progress.text
    found = Calibration.load(file)
    assert found.errors_text in calibration.progress.text
    assert found.robot == "kinectbot"
    assert found.views >= 8
    assert abs(found.estimates["camera yaw"].value) < 0.02  # rad: it sits as the model says
    assert [name for name, *_ in calibration.progress.rows] == list(found.estimates)
    wait_for(lambda: seen.modes.value("point_head", "max_velocity") == (usual or 2.0))


@pytest.mark.parametrize("what", ["stop", "torque"])
def test_stop_and_a_relaxed_joint_end_it(robot, seen, calibration, what, tmp_path):
    calibration.begin(0.16, "")
    wait_for(lambda: "direction 2" in calibration.progress.text)
    if what == "stop":
        robot.call("stop")  # on a busy computer it may not be confirmed in time, but it counts
    else:
        seen.joints.set_torque("head_tilt_controller", False)
    wait_for(lambda: ended(calibration))
    assert not list(tmp_path.rglob("*.yaml"))
    if what == "torque":
        assert "head_tilt_joint" in calibration.progress.text
        seen.joints.set_torque("head_tilt_controller", True)
        wait_for(lambda: not any(servo.refuses for servo in seen.joints.servos()))
    else:
        with pytest.raises(HeadTrackingError):
            calibration.begin(0.16, "")
        robot.until_done("resume")
        wait_for(lambda: not seen.stop.stopped)
