"""point_head in simulated time."""

import math
import random

import pytest

pytest.importorskip("control_msgs.action")

import threading

from geometry_msgs.msg import Point, PointStamped
from goals import HeldGoal, following, point_goal
from rig import JOINTS
from std_srvs.srv import SetBool

from head_tracking.gaze import PanTiltHead
from head_tracking.ros.head import head_actions
from head_tracking.ros.head.point_head import PointHeadNode


class PointedHead:
    """point_head and its servos in simulated time."""

    def __init__(self, world):
        self.world = world
        self.node = world.make(PointHeadNode, {"max_velocity": 5.0}, loop=world.loop)
        self._states = world.record("/point_head/state")
        self.head = PanTiltHead(world.buffer.core.model, *JOINTS, "camera_link")
        world.run(0.1)

    @property
    def said(self):
        """Its latest state."""
        return self._states[-1][1].data if self._states else ""

    def look_at(self, point, frame="", **wishes):
        """Send a goal of PointHead and wait until it is over; no frame: the head's base."""
        held = HeldGoal(point_goal(*point, frame or self.head.base_frame, **wishes))
        self.node.actions.point(held)
        self.world.speeds(20.0, lambda: held.status)
        return held


@pytest.fixture
def pointed(world):
    return PointedHead(world)


def random_point(rnd):
    """Return a point around a head, in its base frame [m]: most can be looked at, some cannot."""
    bearing, height = rnd.uniform(-3.0, 3.0), rnd.uniform(-1.2, 1.2)
    away = math.exp(rnd.uniform(math.log(0.25), math.log(8.0)))
    return (
        away * math.cos(bearing) * math.cos(height),
        away * math.sin(bearing) * math.cos(height),
        away * math.sin(height),
    )


def test_random_goals_report_the_miss_of_the_true_angles(pointed):
    rnd = random.Random(1)
    ends = {"succeeded": 0, "aborted": 0}
    for _ in range(30):
        point, before = random_point(rnd), pointed.world.true
        goal = pointed.look_at(point)
        pointed.world.run(0.02)
        ends[goal.status] += 1
        truly = math.degrees(pointed.head.miss(point, *pointed.world.true))
        if goal.status == "succeeded":
            assert pointed.head.gaze(point, *before).reached
            reported = float(pointed.said.split()[-2])
            assert pointed.said.startswith("arrived")
            assert truly == pytest.approx(reported, abs=0.5)
            assert truly < 1.0
        else:
            assert not pointed.head.gaze(point, *before).reached
            assert pointed.said.startswith("aborted: the target is ")
            assert pointed.world.true == pytest.approx(before, abs=0.006)
    assert min(ends.values()) > 2


def fastest(pointed, goal):
    """Of pan, on the way of a goal [rad/s]; and how long that took [s]."""
    world, held = pointed.world, HeldGoal(goal)
    pointed.node.actions.point(held)
    begun = world.seconds
    speeds = world.speeds(30.0, lambda: held.status)
    assert held.status == "succeeded"
    return max(speeds), world.seconds - begun


def test_velocity_and_duration_are_honoured(pointed):
    frame = pointed.head.base_frame
    speed, _ = fastest(pointed, point_goal(1, 1, 0.1, frame, velocity=0.4))
    assert speed < 0.5
    speed, duration = fastest(pointed, point_goal(1, -1, 0.1, frame, velocity=3.0))
    assert 2.0 < speed < 3.5
    assert duration < 1.7
    speed, duration = fastest(pointed, point_goal(1, 1, 0.1, frame, duration=4.0))
    assert 4.0 <= duration < 5.0
    assert speed < 0.6
    _, duration = fastest(pointed, point_goal(1, 0.98, 0.1, frame, duration=10.0))
    assert 10.0 <= duration < 11.0  # slower than a servo can be told


@pytest.mark.parametrize(
    ("frame", "axis", "meant"),
    [
        ("/camera_optical_frame", (0, 0, 0), (0, 0, 1)),
        ("camera_link", (1, 0.2, 0), (1, 0.2, 0)),
    ],
)
def test_any_frame_and_axis_of_the_head_can_be_pointed(pointed, kinectbot, frame, axis, meant):
    point, base = (1, 0.4, 0.1), pointed.head.base_frame
    held = pointed.look_at(point, f"/{base}", pointing=frame, axis=axis)
    assert held.status == "succeeded"
    assert not pointed.node.actions.point_refusal(held.request)
    head = PanTiltHead(kinectbot, *JOINTS, frame.removeprefix("/"), meant)
    assert head.miss(point, *pointed.world.true) < math.radians(1.0)


@pytest.mark.parametrize("kind", ["point", "follow"])
def test_a_goal_that_replaces_a_moving_target_does_not_stop_the_head(pointed, kind):
    """The motion to the target is fast when the goal comes, which leads on in its direction."""
    world, point = pointed.world, (0.4, 2.0, 0.1)
    message = PointStamped(point=Point(x=point[0], y=point[1], z=point[2]))
    message.header.frame_id = pointed.head.base_frame
    world.publish("/target_point", message)
    world.run(0.25)
    if kind == "point":
        request = point_goal(*point, pointed.head.base_frame, velocity=3.0)
        pointed.node.actions.point(HeldGoal(request))
    else:
        path = dict.fromkeys(JOINTS, -1.0)
        pointed.node.actions.follow(HeldGoal(following((0.6, (1.37, 0.0), (0.0, 0.0)), path=path)))
    speeds = world.speeds(0.2)
    assert speeds[0] > 1.5
    assert min(speeds) > 0.5 * speeds[0]


def test_the_first_trajectory_after_a_stop_is_carried_out_slowly(pointed):
    world = pointed.world
    world.run(0.5)
    world.stop_and_resume(0.5)
    held = HeldGoal(
        following(
            (0.8, (0.6, 0.3), (0.5, 0.0)),
            (1.6, (-0.3, 0.0), (0.0, 0.0)),
            path=dict.fromkeys(JOINTS, 0.1),
        )
    )
    pointed.node.actions.follow(held)
    speeds = world.speeds(30.0, lambda: held.status)
    assert (held.status, held.answer.error_code) == ("succeeded", 0), held.answer.error_string
    assert pointed.world.true == pytest.approx((-0.3, 0.0), abs=0.03)
    assert max(speeds) < 0.4  # rad/s


@pytest.mark.parametrize(("sent_before", "turns"), [(5, False), (900, True)])
def test_a_target_from_before_a_stop_is_refused_unless_its_clock_differs(
    pointed, sent_before, turns
):
    world = pointed.world
    world.stop_and_resume(0.5)
    world.run(0.1)
    message = PointStamped(point=Point(x=1.0, y=1.0, z=0.1))
    message.header.frame_id = pointed.head.base_frame
    message.header.stamp.sec = world.stamp // 10**9 - sent_before
    world.publish("/target_point", message)
    assert (max(world.speeds(2.0)) > 0.1) == turns


def test_a_trajectory_waits_while_the_process_is_held_up(pointed):
    held = HeldGoal(following((4.0, (1.0, 0.0), (0.0, 0.0))))
    pointed.node.actions.follow(held)
    usual = max(pointed.world.speeds(2.0))
    pointed.world.hold_up(3.0)
    speeds = pointed.world.speeds(30.0, lambda: held.status)
    assert held.status == "succeeded"
    assert max(speeds) < 1.2 * usual


def test_the_cycle_goes_on_while_a_trajectory_is_checked(pointed, monkeypatch):
    control, free = pointed.node.control, []

    def checking(*_):
        """Let another thread, like that of the bus, use the head meanwhile."""

        def use():
            free.append(control.lock.acquire(timeout=5.0))
            if free[-1]:
                control.lock.release()

        cycle = threading.Thread(target=use)
        cycle.start()
        cycle.join()

    monkeypatch.setattr(head_actions, "checked_waypoints", checking)
    pointed.node.actions.follow(HeldGoal(following((0.2, (0.1, 0.1)))))
    assert free
    assert all(free)


def begun(head, kind):
    """A goal that turns pan for some seconds, and has just done so for a while."""
    if kind == "point":
        goal = HeldGoal(point_goal(0.0, 2.0, 0.1, head.head.base_frame, velocity=0.5))
        head.node.actions.point(goal)
    else:
        goal = HeldGoal(following((4.0, (1.2, 0.0)), path=dict.fromkeys(JOINTS, -1.0)))
        head.node.actions.follow(goal)
    head.world.run(1.0)
    assert not goal.status
    return goal


def test_a_program_that_stands_still_before_its_first_command_takes_no_joint_for_blocked(pointed):
    """Between a measurement and what follows from it, as on a busy computer."""
    world, write = pointed.world, pointed.world.write

    def stand_still(*goals):
        world.is_measured, world.write = False, write

        def go_on():
            world.is_measured = True
            write(*goals)

        world.at(world.now + 450_000_000, go_on)

    world.write = stand_still
    assert pointed.look_at((1.0, 0.5, 0.1)).status == "succeeded", pointed.said


@pytest.mark.parametrize("kind", ["point", "follow"])
def test_a_blocked_joint_aborts_the_goal(pointed, kind):
    head, goal = pointed, begun(pointed, kind)
    head.world.impede("head_pan_joint", 1.5)
    head.world.run(0.6)
    assert goal.status == "aborted"
    assert "head_pan_joint not following" in head.said
    assert ("misses the target by" in head.said) is (kind == "point")
    if kind == "follow":
        assert goal.answer.error_code == -4
        assert "head_pan_joint" in goal.answer.error_string
    head.world.impede("head_pan_joint", 0.0)
    stood = head.world.true
    head.world.run(1.0)
    assert head.world.true == pytest.approx(stood, abs=0.05)  # nobody takes it on
    assert head.look_at((2.0, 0.5, 0.1)).status == "succeeded"


@pytest.mark.parametrize("kind", ["point", "follow"])
@pytest.mark.parametrize(
    "end",
    [
        lambda pointed: pointed.world.stop_and_resume(0.03),
        lambda pointed: pointed.node._on_enable(SetBool.Request(data=False)),
        lambda pointed: pointed.world.loop.owners.take_over("/somebody", JOINTS),
    ],
    ids=["stopped", "disabled", "taken over"],
)
def test_a_goal_is_aborted_when_the_head_is_stopped_disabled_or_taken_over(pointed, kind, end):
    goal = begun(pointed, kind)
    end(pointed)
    pointed.world.run(0.1)
    assert goal.status == "aborted"
    pointed.world.run(1.0)  # the servos reach the goals that they have
    stood = pointed.world.true
    pointed.world.run(1.0)
    assert pointed.world.true == pytest.approx(stood, abs=0.005)
