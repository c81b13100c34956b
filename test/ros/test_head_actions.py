"""PointHead, as stock clients of PR2, TIAGo and Fetch use it."""

import math
import random
import time

import pytest
from action_client import ABORTED, CANCELED, SUCCEEDED, Client
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Vector3
from robot_under_test import wait_for
from std_msgs.msg import String

from head_tracking.gaze import PanTiltHead
from head_tracking.tf.qos import LATCHED
from head_tracking.transforms import Rotation, Transform

control_msgs = pytest.importorskip("control_msgs.action")
PointHead = control_msgs.PointHead
JOINTS = ("head_pan_joint", "head_tilt_joint")
DEGREE = math.radians(1.0)


def goal(x, y, z, frame="base_link", *, velocity=0.0, duration=0.0, pointing="", axis=(0, 0, 0)):
    made = PointHead.Goal(pointing_frame=pointing, max_velocity=float(velocity))
    made.target.header.frame_id = frame
    made.target.point = Point(x=float(x), y=float(y), z=float(z))
    made.pointing_axis = Vector3(x=float(axis[0]), y=float(axis[1]), z=float(axis[2]))
    made.min_duration = Duration(sec=int(duration), nanosec=round(duration % 1 * 1e9))
    return made


@pytest.fixture(scope="module")
def running(make_module_robot):
    robot = make_module_robot("--mode", "point")
    robot.client = Client(robot.node, PointHead, "point_head/point_head_action")
    robot.states = []
    robot.node.create_subscription(
        String, "point_head/state", lambda m: robot.states.append(m.data), LATCHED
    )
    return robot


@pytest.fixture
def robot(running):
    """Awake, looking straight on, and quick."""
    running.call("resume")
    running.call("point_head/enable", True)
    assert running.call("torque_enable", True).success
    running.composition.nodes["point_head"].interface.slow = False
    status, _ = running.client.send(goal(3, 0, 0.4)).ended()
    assert status == SUCCEEDED
    running.forget_log()
    return running


def head_of(robot, frame="camera_link", axis=None):
    return PanTiltHead(robot.composition.buffer.core.model, *JOINTS, frame, axis)


def true_miss(robot, head, point, frame="base_link"):
    """By how much the true servo angles miss a point [rad]."""
    core = robot.composition.buffer.core
    target = core.transform_point(point, head.base_frame, frame)
    return head.miss(target, *(robot.true(joint) for joint in JOINTS))


def test_a_goal_succeeds_when_the_measured_joints_have_arrived(robot):
    sent = robot.client.send(goal(1, 1, 0.2))
    status, _ = sent.ended()
    assert status == SUCCEEDED
    assert "arrived" in robot.logged("turning camera_link to (1.000, 1.000, 0.200) in base_link: ")
    assert true_miss(robot, head_of(robot), (1, 1, 0.2)) < DEGREE
    times = [at for at, _ in sent.feedback]
    angles = [message.pointing_angle_error for _, message in sent.feedback]
    assert angles[0] > 0.6  # measured, not meant
    assert angles[-1] < DEGREE
    assert len(times) > 10 * (times[-1] - times[0])


def test_the_reported_miss_is_that_of_the_true_angles(robot):
    """A short one of scripts/benchmark/measure interfaces."""
    rnd, head = random.Random(3), head_of(robot)
    for _ in range(12):
        bearing, distance = rnd.uniform(-1.8, 1.8), rnd.uniform(0.8, 4.0)
        point = distance * math.cos(bearing), distance * math.sin(bearing), rnd.uniform(0.1, 1.0)
        sent = robot.client.send(goal(*point, velocity=5.0))
        status, _ = sent.ended()
        said = robot.states
        wait_for(lambda said=said: said[-1].startswith("arrived"))
        reported = float(said[-1].split()[-2])
        assert status == SUCCEEDED
        truly = math.degrees(true_miss(robot, head, point))
        assert truly == pytest.approx(reported, abs=0.5)
        assert truly < 1.0


def test_a_newer_goal_preempts_the_older(robot):
    first = robot.client.send(goal(1, 2, 0.2, velocity=0.5))
    wait_for(lambda: robot.pan > 0.1)
    goals = robot.goals()
    sent = time.monotonic()
    second = robot.client.send(goal(1, -2, 0.2))
    status, _ = first.ended()
    assert status == ABORTED
    assert first.ended_at - sent < 0.5  # 0.04 on a machine that has time: see the benchmark
    wait_for(lambda: any(told["head_pan_joint"].position < 0 for told in goals))
    assert second.ended()[0] == SUCCEEDED
    assert robot.pan < -1.0
    assert "preempted by a newer goal" in robot.logged("aborted: preempted")


def test_cancel_holds(robot):
    sent = robot.client.send(goal(1, 2, 0.2, velocity=0.5))
    wait_for(lambda: robot.pan > 0.2)
    assert len(sent.cancel().goals_canceling) == 1
    assert sent.ended()[0] == CANCELED
    pan, _ = robot.at_rest()
    assert 0.2 < pan < 0.6
    assert robot.states[-1] == "canceled: the head holds"
    assert not sent.cancel().goals_canceling


def test_velocity_and_duration_are_honoured(robot):
    velocities = robot.listen_to_velocity("head_pan_joint")
    begun = time.monotonic()
    status, _ = robot.client.send(goal(1, 1, 0.3, velocity=0.4)).ended()
    assert status == SUCCEEDED
    assert max(velocities) < 0.5
    begun = time.monotonic()
    status, _ = robot.client.send(goal(1, 0.6, 0.3, duration=2.5)).ended()
    assert status == SUCCEEDED
    assert time.monotonic() - begun > 2.4
    velocities.clear()
    assert robot.client.send(goal(3, 0, 0.4)).ended()[0] == SUCCEEDED
    assert max(velocities) > 0.6


@pytest.mark.parametrize(
    ("frame", "axis", "meant"),
    [
        ("/camera_optical_frame", (0, 0, 0), (0, 0, 1)),
        ("camera_link", (1, 0.2, 0), (1, 0.2, 0)),
        ("head_link", (0, 0, 0), (1, 0, 0)),
    ],
)
def test_any_frame_and_axis_of_the_head_can_be_pointed(robot, frame, axis, meant):
    status, _ = robot.client.send(
        goal(1, 0.4, 0.3, "/base_link", pointing=frame, axis=axis)
    ).ended()
    assert status == SUCCEEDED
    head = head_of(robot, frame.removeprefix("/"), meant)
    assert true_miss(robot, head, (1, 0.4, 0.3)) < DEGREE


def test_a_target_out_of_reach_is_aborted_with_the_miss(robot):
    before = robot.at_rest()
    status, _ = robot.client.send(goal(0, 0, -3, "camera_link")).ended()
    assert status == ABORTED
    said = robot.logged("out of reach")
    assert "the nearest gaze would miss it by" in said
    assert "degrees" in said
    assert robot.states[-1].startswith("aborted: ")
    assert robot.at_rest() == pytest.approx(before, abs=0.01)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (goal(math.nan, 0, 0), "not finite"),
        (goal(1, 0, 0, "nowhere"), "'nowhere' does not exist"),
        (goal(1, 0, 0, ""), "no frame name"),
        (goal(1, 0, 0, pointing="torso_link"), "not carried by"),
        (goal(1, 0, 0, pointing="nose"), "no link 'nose'"),
        (goal(1, 0, 0, velocity=-1), "below 0"),
        (goal(1, 0, 0, velocity=math.inf), "not finite"),
        (goal(1, 0, 0, axis=(math.nan, 0, 0)), "not finite"),
    ],
)
def test_what_cannot_be_looked_at_is_rejected_with_the_reason(robot, wrong, words):
    assert not robot.client.send(wrong).accepted
    assert words in robot.logged("is rejected")
    wait_for(lambda: robot.states[-1].startswith("rejected: "))


def test_a_stopped_head_takes_no_goal_and_a_stop_aborts_the_one_under_way(robot):
    sent = robot.client.send(goal(1, 2, 0.2, velocity=0.3))
    wait_for(lambda: robot.pan > 0.1)
    assert robot.call("stop").success
    assert sent.ended()[0] == ABORTED
    assert not robot.client.send(goal(1, 0, 0.3)).accepted
    assert "stopped" in robot.logged("is rejected")


def test_who_is_off_or_not_the_owner_takes_no_goal_and_names_the_owner(robot):
    sent = robot.client.send(goal(1, 2, 0.2, velocity=0.3))
    wait_for(lambda: robot.pan > 0.1)
    assert robot.call("point_head/enable", False).success
    assert sent.ended()[0] == ABORTED
    pan, _ = robot.at_rest()
    assert pan < 0.5
    assert not robot.client.send(goal(1, 0, 0.3)).accepted
    robot.logged("is rejected: pointing is switched off")
    robot.composition.loop.owners.take_over("/somebody", JOINTS)
    node = robot.composition.nodes["point_head"]
    node.interface.off = ""
    assert not robot.client.send(goal(1, 0, 0.3)).accepted
    robot.logged("is rejected: the joints belong to /somebody")
    robot.composition.loop.owners.release("/somebody")


def test_a_goal_in_a_frame_that_moves_is_followed_until_arrived(robot):
    core, begun = robot.composition.buffer.core, time.time()

    def hand(now):
        bearing = 0.9 - 0.5 * min(now - begun, 3.0)
        return Transform((2 * math.cos(bearing), 2 * math.sin(bearing), 0.3), Rotation.identity())

    def move():
        now = time.time()
        core.set_transform(round(now * 1e9), "base_link", "hand", hand(now))

    move()
    timer = robot.node.create_timer(0.02, move)
    try:
        sent = robot.client.send(goal(0, 0, 0, "hand", velocity=1.0, duration=1.5))
        assert sent.ended()[0] == SUCCEEDED
        point = hand(time.time()).translation
        assert true_miss(robot, head_of(robot), point) < 3 * DEGREE
    finally:
        robot.node.destroy_timer(timer)


def test_a_goal_in_the_heads_own_frame_does_not_run_before_it(robot):
    pan = robot.pan
    assert robot.client.send(goal(2, 0.6, 0, "camera_link")).ended()[0] == SUCCEEDED
    assert robot.pan == pytest.approx(pan + math.atan2(0.6, 2), abs=0.05)


def test_a_target_point_does_not_disturb_a_goal_and_recentring_ends_it(robot):
    sent = robot.client.send(goal(1, 1, 0.2, velocity=0.5))
    robot.look_at(1, -1, 0, "base_link")
    assert sent.ended()[0] == SUCCEEDED
    robot.look_at(1, -1, 0, "base_link")
    wait_for(lambda: robot.pan < -0.6)
    sent = robot.client.send(goal(1, 1, 0.2, velocity=0.5))
    assert robot.call("point_head/recenter").success
    assert sent.ended()[0] == ABORTED
    wait_for(lambda: abs(robot.pan) < 0.02)


def test_a_head_that_is_held_says_that_it_did_not_arrive(robot):
    robot.simulated.port.push(1, 3.0)  # twice what the servo can stand against
    try:
        assert robot.client.send(goal(1, -1, 0.3)).ended()[0] == ABORTED
        robot.logged("did not arrive: the head misses the target by")
    finally:
        robot.simulated.port.push(1, 0.0)
        robot.call("recover")
