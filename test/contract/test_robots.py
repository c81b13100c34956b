"""Every robot that comes with the package: its model, its servos, and its head in simulation."""

import pytest
from rig import DEGREE
from robot_pursuit import pursue

from head_tracking import Head, HeadState
from head_tracking.configuration import configured_head
from head_tracking.gaze import PanTiltHead
from head_tracking.parameter_files import read
from head_tracking.share import robot_file, robot_names, robot_parameters
from head_tracking.tracking import FictitiousTarget, FictitiousTargetParameters
from head_tracking.transforms import load_robot_model

ROBOTS = robot_names()
AHEAD = (0.0, 0.0, 1.0)  # in the optical frame


class Robot:
    def __init__(self, name):
        self.model = load_robot_model(robot_file(name))
        self.configured = configured_head(robot_parameters(name))
        self.servos = self.configured.servos
        self.names = [servo.joint_name for servo in self.servos]
        self.head = PanTiltHead(self.model, *self.names, self.configured.pointing_frame)

    def in_base(self, point):
        """Return a point of the pan joint's parent in base_link [m]."""
        return self.model.transform("base_link", self.head.base_frame, {}) @ point

    def direction(self, joints, of):
        """Return a direction of the optical frame in base_link."""
        pose = dict(zip(self.names, joints, strict=True))
        return self.model.transform("base_link", "camera_optical_frame", pose).rotation @ of


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request):
    return Robot(request.param)


def test_all_listed_robots_exist():
    interbotix = {"pxxls", "pxxls_cam", "wxxms", "wxxmd", "vxxms", "vxxmd", "locobot"}
    humanoids = {"op3", "darwin_op", "poppy", "wolfgang"}
    others = {"kinectbot", "turtlebot", "stretch", "phantomx_turret", "two_ax_12", "two_sts3215"}
    assert interbotix | humanoids | others <= set(ROBOTS)
    assert "shapes" not in ROBOTS  # a part of models
    for name in ROBOTS:
        assert robot_file(str(robot_file(name))) == robot_file(name)
    with pytest.raises(FileNotFoundError, match=r"'r2d2'.*kinectbot.*turtlebot"):
        robot_file("r2d2")


def test_limits_of_model_and_servo_agree(robot):
    for servo in robot.servos:
        limits = robot.model.joints[servo.joint_name].limits
        tick = servo.calibrations[0].resolution
        slack = 0.02 if servo.lower < -2.6 and servo.model.name == "AX-12" else 1.01 * tick
        assert servo.lower == pytest.approx(limits.lower, abs=slack)
        assert servo.upper == pytest.approx(limits.upper, abs=slack)


def test_the_camera_looks_ahead_and_its_picture_is_upright(robot):
    assert robot.direction((0.0, 0.0), AHEAD) == pytest.approx((1.0, 0.0, 0.0), abs=1e-6)
    on_its_side = "joint_head_pan" in robot.names  # Stretch's
    down = (0.0, 1.0, 0.0) if on_its_side else (0.0, 0.0, -1.0)
    assert robot.direction((0.0, 0.0), (0.0, 1.0, 0.0)) == pytest.approx(down, abs=1e-6)


def test_the_target_of_a_simulated_run_is_in_reach(robot):
    files = [read(str(file)) for file in robot_parameters(robot.model.name)]
    given = [each for values in files for each in values if each.node == "fictitious_target"]
    values = {each.name: each.value for each in given}
    frame = values.pop("frame_id", "base_link")
    pose = robot.model.transform(robot.head.base_frame, frame, {})
    target = FictitiousTarget(FictitiousTargetParameters(**values))
    path = [pose @ target.advance(10.0) for _ in range(100)]
    assert all(robot.head.gaze(point, 0.0, 0.0).reached for point in path)


def servo_models(name):
    return tuple(servo.model.name for servo in configured_head(robot_parameters(name)).servos)


@pytest.mark.parametrize("name", {servo_models(name): name for name in ROBOTS}.values())
def test_the_simulated_head_looks_there(name):
    with Head.simulated(robot=name) as head:
        result = head.look_at(Robot(name).in_base((2.0, 0.5, -0.2)))
        assert result.arrived
        assert result.miss < DEGREE
        assert head.state is HeadState.HOLDING
    assert head.state is HeadState.CLOSED


@pytest.mark.parametrize("name", ROBOTS)
def test_the_simulated_head_keeps_a_moving_target(name):
    """In simulated time: servos, bus and tracker of the robot, a target at 0.5 Hz."""
    assert pursue(name, 3.0) < 1.5 * DEGREE
