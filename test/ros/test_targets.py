"""frame_target, target_mux and look over real topics."""

import math

import pytest
from geometry_msgs.msg import Point, PointStamped, PoseStamped
from rclpy.parameter import Parameter
from robot_under_test import wait_for
from std_msgs.msg import String

from head_tracking.nodes.frame_target import FrameTargetNode
from head_tracking.nodes.target_mux import TargetMuxNode
from head_tracking.ros.stop_signal import StopSignal
from head_tracking.tf.qos import LATCHED
from head_tracking.tools.look import look
from head_tracking.transforms import Rotation, Transform

DEGREE = math.radians(1)


def start(robot, make, **parameters):
    node = make(
        buffer=robot.composition.buffer,
        parameter_overrides=[Parameter(name, value=value) for name, value in parameters.items()],
    )
    robot.threads.start(node)
    return node


# frame_target


def test_the_head_follows_a_frame_that_another_program_publishes(tracking_robot):
    robot = tracking_robot
    start(robot, FrameTargetNode, frame="hand", offset=[0.0, 0.0, 0.1])
    targets = robot.listen("target_point", PointStamped)
    core = robot.composition.buffer.core
    ball = Transform((1.0, 0.5, 0.4), Rotation.identity())

    def sees():
        core.set_transform(robot.node.get_clock().now().nanoseconds, "base_link", "hand", ball)
        return abs(robot.pan - math.atan2(0.5, 1.0 - 0.0115)) < 2 * DEGREE

    wait_for(sees)
    assert targets[-1].header.frame_id == "base_link"
    assert targets[-1].point.z == pytest.approx(0.5)


def test_it_says_why_there_is_no_target(tracking_robot):
    start(tracking_robot, FrameTargetNode, frame="left_hand")
    tracking_robot.logged("frame 'left_hand' does not exist")


@pytest.mark.parametrize("make", [FrameTargetNode, TargetMuxNode])
def test_every_parameter_is_described(tracking_robot, make):
    node = start(tracking_robot, make)
    for name in set(node._parameters) - {"use_sim_time", "start_type_description_service"}:
        assert node.describe_parameter(name).description, name


# target_mux


@pytest.fixture
def mux(tracking_robot):
    return start(tracking_robot, TargetMuxNode, sources=["clicked_point", "target_pose", "face"])


def selection(robot):
    names = []
    robot.node.create_subscription(String, "target_mux/selected", names.append, LATCHED)
    wait_for(lambda: names)
    return names


def point(robot, x, y, z, frame="base_link"):
    message = PointStamped(point=Point(x=float(x), y=float(y), z=float(z)))
    message.header.frame_id = frame
    message.header.stamp = robot.node.get_clock().now().to_msg()
    return message


def test_a_clicked_point_takes_over_smoothly_and_is_held(tracking_robot, mux):
    robot = tracking_robot
    names = selection(robot)
    sent = robot.listen("target_point", PointStamped)

    def face_is_followed():
        robot.publish("face/target_point", point(robot, 2, 1, 0.6))
        return len(sent) > 5

    wait_for(face_is_followed)
    assert names[-1].data == "face"
    assert sent[-1].point.y == pytest.approx(1.0)

    def clicked_is_looked_at():
        robot.publish("face/target_point", point(robot, 2, 1, 0.6))
        robot.publish("clicked_point", point(robot, 2, -1, 0.6))
        return names[-1].data == "clicked_point"

    wait_for(clicked_is_looked_at)
    wait_for(lambda: abs(sent[-1].point.y + 1.0) < 1e-6)
    between = [message.point.y for message in sent if -0.95 < message.point.y < 0.95]
    assert len(between) > 3, "a jump"
    count = len(sent)
    wait_for(lambda: len(sent) > count + 10)
    assert sent[-1].header.stamp != sent[count].header.stamp


def test_a_pose_can_be_the_target_and_a_person_can_pin_another(tracking_robot, mux):
    robot = tracking_robot
    names = selection(robot)
    pose = PoseStamped(header=point(robot, 0, 0, 0).header)
    pose.pose.position = Point(x=1.0, y=0.5, z=0.7)
    robot.publish("target_pose", pose)
    wait_for(lambda: names[-1].data == "target_pose")
    wait_for(lambda: robot.pan > 0.3)
    robot.publish("target_mux/pin", String(data="nobody"))
    robot.logged("there is no source 'nobody'; there are clicked_point, target_pose, face")
    robot.publish("target_mux/pin", String(data="face"))
    wait_for(lambda: names[-1].data == "")
    robot.publish("target_mux/pin", String())
    wait_for(lambda: names[-1].data == "target_pose")


def test_a_target_that_is_not_finite_is_not_passed_on(tracking_robot, mux):
    names = selection(tracking_robot)
    tracking_robot.publish("face/target_point", point(tracking_robot, math.nan, 0, 0))
    tracking_robot.logged("face: the target (nan, 0.000, 0.000) in base_link is not finite")
    assert names[-1].data == ""


def test_the_output_cannot_be_a_source(tracking_robot):
    with pytest.raises(ValueError, match="give the source a topic of its own"):
        start(tracking_robot, TargetMuxNode, sources=["face"], **{"face.topic": "/target_point"})


# look


@pytest.fixture
def ask(capsys):
    def ask(robot, *arguments, stop=None):
        buffer = robot.composition.buffer
        with StopSignal() as signal:
            for condition in [stop] if stop else []:
                condition(signal)
            code = look(robot.node, buffer, arguments, signal)
        out, err = capsys.readouterr()
        return code, out + err

    return ask


@pytest.mark.parametrize("mode", ["point", "track"])
def test_look_at_a_point_and_back_to_the_centre(make_robot, ask, mode):
    robot = make_robot("--mode", mode, "--target", "none")
    code, text = ask(robot, "1", "-1", "0.5", "--frame", "base_link")
    assert code == 0, text
    assert "arrived: the head misses the target by" in text
    assert robot.pan == pytest.approx(-math.pi / 4, abs=2 * DEGREE)
    code, text = ask(robot, "--centre", "--timeout", "15")
    assert code == 0, text
    assert (robot.pan, robot.tilt) == pytest.approx((0.0, 0.0), abs=2 * DEGREE)


def test_look_says_why_it_cannot(pointing_robot, ask):
    for arguments, words in (
        (("-1", "0", "0.45", "--frame", "base_link"), "nothing moves: the target is out of reach"),
        (("--frame", "nose"), "nothing moves: the frame 'nose' does not exist"),
        (("--frame", "base_link", "--pan-joint", "neck"), "neck"),
        (("1", "0", "1", "--frame", "base_link", "--topic", "t", "--wait", "0.3"), "listens on t"),
    ):
        code, text = ask(pointing_robot, *arguments)
        assert (code, words in text) == (1, True), text


def test_look_tells_by_how_much_the_head_missed(pointing_robot, ask):
    pointing_robot.call("relax")
    code, text = ask(pointing_robot, "1", "1", "0.5", "--frame", "base_link", "--timeout", "1")
    assert code == 1
    assert "did not arrive: the head misses the target by 4" in text


def test_look_follows_until_it_is_stopped(pointing_robot, ask):
    robot = pointing_robot

    def when_there(signal):
        before = []

        def check():
            before.append((robot.pan, robot.tilt))
            stands = len(before) > 10 and len(set(before[-6:])) == 1
            if stands and abs(robot.pan - 0.5) < 2 * DEGREE:
                signal.set()

        robot.node.create_timer(0.05, check)

    robot.composition.buffer.core.set_transform(
        robot.node.get_clock().now().nanoseconds,
        "head_pan_link",
        "gripper",
        Transform((math.cos(0.5) + 0.0115, math.sin(0.5), 0.1), Rotation.identity()),
    )
    code, text = ask(robot, "--frame", "gripper", "--follow", stop=when_there)
    assert code == 0, text
    assert "stopped: the head misses the target by" in text


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["1", "2"],
        ["1", "2", "3"],
        ["--centre", "--frame", "a"],
        ["1", "x", "2", "--frame", "a"],
    ],
)
def test_a_mistake_on_the_command_line_is_told(pointing_robot, ask, arguments):
    with pytest.raises(SystemExit, match="2"):
        ask(pointing_robot, *arguments)
