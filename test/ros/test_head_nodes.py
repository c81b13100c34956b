"""The nodes that control a head, in simulated time, and the summary of a run."""

import math
import re
import time
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, PointStamped
from lockstep import World
from rclpy.parameter import Parameter
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from waiting import repeating, wait_for

from head_tracking.configuration.head_nodes import HEAD_NODES
from head_tracking.dynamixel import BusStatistics, BusTiming, ServoStatistics, Torque
from head_tracking.dynamixel.state import Counters
from head_tracking.gaze import PointingParameters
from head_tracking.head.motions import PointMotion
from head_tracking.head.obstacle import Blocked
from head_tracking.ros.head.head_node import HeadNode
from head_tracking.ros.head.head_tracker import HeadTrackerNode
from head_tracking.ros.head.point_head import PointHeadNode
from head_tracking.ros.targets.target_mux import TargetMuxNode
from head_tracking.run.run_monitor import RunMonitor
from head_tracking.tracking import ServoValues, Target
from head_tracking.transforms import RobotModel, Rotation, Transform, parse_robot_model

SECOND = 1_000_000_000  # ns
STEP = 0.02  # s
AWAY = 0.7  # rad


class Tracked:
    """A node that controls a head, its servos, and a target that is seen 50 times a second."""

    def __init__(
        self, kind: type[HeadNode], model: RobotModel | None, parameters: dict[str, Any]
    ) -> None:
        self.world = world = World(model)
        # the bearing of the target [rad] at a time [s]; None: there is no target
        self.path: Callable[[float], float] | None = None
        self.fields: dict[str, str] = {}  # of the latest `~/status`
        for name in ("head_tracker", "point_head"):
            world.listen(f"/{name}/status", self._on_status)
        self.node = world.make(kind, parameters, loop=world.loop)
        world.every(round(STEP * SECOND), self._publish)
        world.run(0.5)

    def target(self, bearing: float) -> Target:
        """Return the target at a bearing, stamped now."""
        point = 2.0 * math.cos(bearing), 2.0 * math.sin(bearing), 0.1
        return Target(self.world.stamp, "torso_link", point)

    def see(self, bearing: float | None, seconds: float) -> None:
        """Let time pass with a target at a bearing [rad]; None: without one."""
        self.path = None if bearing is None else lambda now: bearing
        self.world.run(seconds)

    def _on_status(self, message: DiagnosticStatus) -> None:
        self.fields = {each.key: each.value for each in message.values}

    def _publish(self) -> None:
        if self.path is not None:
            self.node.control.accept(self.target(self.path(self.world.seconds)))


@pytest.fixture
def track(kinectbot, threads):
    def track(kind=HeadTrackerNode, model=kinectbot, **parameters):
        return Tracked(kind, model, parameters)

    return track


def test_a_resumed_head_stays_slow_over_jumps_and_while_there_is_no_target(track):
    tracked = track()
    tracked.world.stop_and_resume()
    tracked.path = lambda now: AWAY
    assert 0.1 < max(tracked.world.speeds(0.3)) < 0.35
    tracked.path = None
    for jump in (-900, 3600):
        tracked.world.offset += jump * SECOND
        tracked.world.run(3.0)
    tracked.path = lambda now: -AWAY
    assert 0.1 < max(tracked.world.speeds(1.0)) < 0.35
    tracked.world.run(6.0)
    tracked.path = lambda now: AWAY
    assert max(tracked.world.speeds(1.0)) > 1.0


def test_short_pauses_of_the_target_are_not_logged(track, capfd):
    tracked = track()
    for _ in range(3):
        tracked.see(0.1, 1.0)
        tracked.see(None, 0.3)
        assert tracked.fields["state"] == "coasting"
    assert capfd.readouterr().err.count("tracking: ") == 1


def test_the_log_names_the_target_at_which_a_turn_ends(track, capfd):
    tracked = track(PointHeadNode)
    tracked.see(AWAY, 0.2)
    latest = tracked.target(-AWAY)
    tracked.see(-AWAY, 4.0)
    assert f"to {latest}: arrived" in capfd.readouterr().err


def test_every_refused_target_is_logged_with_its_own_reason(track, monkeypatch):
    """The state keeps the first reason for a second."""
    tracked = track()
    control, refusals = tracked.node.control, []
    monkeypatch.setattr(control, "refuse", refusals.append)
    sent = []
    for age in (5, 9):
        target = tracked.target(0.1)
        sent.append((replace(target, stamp=target.stamp - age * SECOND), age))
        control.accept(sent[-1][0])
        tracked.world.run(2 * STEP)
    assert [target for target, _ in refusals] == [target for target, _ in sent]
    for refusal, (_, age) in zip(refusals, sent, strict=True):
        number = float(re.search(r"([\d.]+) s", refusal.reason)[1])
        assert number == pytest.approx(age, abs=0.1)
    assert "5" in tracked.fields["refusal"]


def test_a_resumed_head_keeps_max_joint_speed(track):
    tracked = track(max_joint_speed=0.1)
    tracked.world.stop_and_resume()
    tracked.path = lambda now: AWAY
    assert 0.05 < max(tracked.world.speeds(3.0)) < 0.12


def test_a_motion_that_replaces_tracking_does_not_stop_the_head(track):
    """As `Head.look_at` after `Head.follow`."""
    tracked = track()
    begun = tracked.world.seconds
    tracked.path = lambda now: now - begun
    tracked.world.run(1.0)
    p = PointingParameters(max_velocity=1.0)
    control = tracked.node.control
    control.start(PointMotion(control, tracked.target(2.0), p, lambda motion: None))
    speeds = tracked.world.speeds(0.2)
    assert speeds[0] > 0.7
    assert min(speeds) > 0.5


PAN_DELAY = "head_pan_joint: delay of its servo"


def turn_to_and_fro(tracked, times=3):
    for k in range(times):
        target = tracked.target(AWAY * (-1) ** k)
        control = tracked.node.control
        control.start(PointMotion(control, target, PointingParameters(), lambda motion: None))
        tracked.world.run(2.0)


def test_all_motions_and_laws_share_what_is_learned_of_the_servos(track):
    tracked = track()
    law = tracked.node.control.law

    def shown():
        tracked.world.run(1.1)
        status = tracked.world.heard["/diagnostics"][-1][1].status[0]
        return {each.key: each.value for each in status.values}[PAN_DELAY]

    tracked.world.record("/diagnostics")
    turn_to_and_fro(tracked)
    learned = law.learned[PAN_DELAY]
    assert learned.source == "learned"
    assert shown().startswith(f"{learned.value:.3g} ")
    for name in ("position", "predictive"):
        tracked.node.set_parameters([Parameter("law", value=name)])
    assert law.learned[PAN_DELAY] == learned
    tracked.node.set_parameters([Parameter("servo_delay", value=0.3)])
    turn_to_and_fro(tracked, 1)
    assert law.delays == (0.3, 0.3)
    tracked.node.set_parameters(
        [Parameter("servo_delay", value=0.0), Parameter("servo_learning", value="forget")]
    )
    assert shown().endswith("not observable")
    turn_to_and_fro(tracked)
    learned = law.learned[PAN_DELAY]
    assert learned.source == "learned"  # anew
    tracked.node.set_parameters([Parameter("max_joint_speed", value=4.0)])
    assert law.learned[PAN_DELAY] == learned
    tracked.node.set_parameters([Parameter("servo_learning", value="forget")])  # once more
    assert shown().endswith("not observable")


def test_saved_values_that_do_not_fit_are_dropped_with_a_warning_in_any_motion(track, monkeypatch):
    tracked, warned = track(), []
    control = tracked.node.control
    monkeypatch.setattr(control, "warn", lambda subject, text: warned.append(subject))
    control.law.expect({"head_pan_joint": ServoValues(0.3, 0.015, 0.0)})
    turn_to_and_fro(tracked)
    assert warned == ["head_pan_joint"]
    assert control.law.learned[PAN_DELAY].source == "learned"


# the summary of a run


class Judged:
    """The run of a head that does not move, whatever its node commands."""

    def __init__(self, tracked: Tracked) -> None:
        self.tracked = tracked
        self.servos: tuple[ServoStatistics, ...] = ()
        thread: Any = SimpleNamespace(
            bus=SimpleNamespace(statistics=lambda: BusStatistics(1, 0, 0, self.servos)),
            timing=BusTiming(50.0, 50.0, 0.0, 0),
        )
        world = tracked.world
        self.positions = dict.fromkeys(tracked.node.control.joints, 0.0)
        self.monitor = RunMonitor(
            tracked.node.control, [thread], self.positions.__getitem__, lambda: world.seconds
        )
        world.every(SECOND // 10, self.monitor.update)

    def after(self, seconds: float, bearing: float | None) -> tuple[float, float]:
        """Let time pass; return the largest error [rad] and the judged time [s] of the run."""
        self.tracked.see(bearing, seconds)
        found = re.search(r"([\d.]+)° max .* over ([\d.]+) s", self.monitor.summary())
        return (math.radians(float(found[1])), float(found[2])) if found else (0.0, 0.0)


def turn_the_head_in_the_model(world: World) -> None:
    """Receive a robot_description in which the pan joint is mounted at another angle."""
    urdf = world.buffer.core.model.urdf
    origin = '<origin xyz="0.0115 0 0.022"'
    assert origin in urdf
    world.buffer.core.set_model(parse_robot_model(urdf.replace(origin, f'{origin} rpy="0 0 1"')))


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (turn_the_head_in_the_model, 1.0),
        (lambda world: setattr(world, "offset", -997 * SECOND), AWAY),
        (lambda world: setattr(world, "offset", 3600 * SECOND), AWAY),
    ],
    ids=["model", "back", "forward"],
)
def test_the_summary_goes_on_after_another_model_and_a_jump_of_the_clock(track, change, expected):
    judged = Judged(track())
    largest, seconds = judged.after(7.0, AWAY)
    assert largest == pytest.approx(AWAY, abs=0.1)
    assert seconds == pytest.approx(5.0, abs=0.5)
    change(judged.tracked.world)
    largest, seconds = judged.after(7.0, 0.0)
    assert largest == pytest.approx(expected, abs=0.1)
    assert 9.0 < seconds < 12.5


def test_the_summary_judges_a_target_from_a_while_after_it_came_until_it_is_given_up(track):
    judged = Judged(track(recenter_timeout=3.0))
    assert judged.after(1.8, AWAY) == (0.0, 0.0)
    judged.after(5.0, 0.0)
    _, seconds = judged.after(5.0, None)
    assert judged.after(5.0, None)[1] == seconds
    assert judged.after(5.0, AWAY)[1] == pytest.approx(seconds + 5.0, abs=1.0)


def test_the_status_has_no_error_of_a_head_that_is_not_measured(track):
    judged = Judged(track())
    judged.after(3.0, AWAY)
    error, measured, *_ = judged.monitor.update()
    assert "°" in error and "pan" in measured
    judged.positions.clear()
    error, measured, *_ = judged.monitor.update()
    assert "°" not in error and measured == "waiting for the head"


def test_limits_of_the_servos_are_limits_of_the_head_also_those_that_change(track):
    tracked = track()
    world = tracked.world
    tracked.see(AWAY, 2.0)
    world.allowed["head_pan_joint"] = -0.3, 0.3
    tracked.see(AWAY, 2.0)
    assert tracked.fields["state"] == "at the limit"
    assert world.true_position("head_pan_joint") == pytest.approx(0.3, abs=0.02)
    turning = track(PointHeadNode)
    turning.world.allowed = world.allowed
    turning.see(AWAY, 2.0)
    assert turning.world.writes == 0
    assert "0.3" in turning.fields["refusal"]


def test_a_head_that_is_measured_again_is_not_commanded_before_the_next_target(track):
    tracked = track()
    world = tracked.world
    tracked.see(AWAY, 2.0)
    tracked.see(None, 3.0)
    world.is_measured = False  # such as its adapter is unplugged
    tracked.target = lambda point: Target(0, "base_link", (1.0, -1.0, 0.5))  # without a stamp
    for bearing in (AWAY, None):
        tracked.see(bearing, 1.5)
        time.sleep(0.02)
    before, world.is_measured = world.writes, True
    world.run(12.0)
    assert (world.writes, tracked.fields["state"]) == (before, "idle")
    del tracked.target
    tracked.see(-AWAY, 2.0)
    assert world.true_position("head_pan_joint") == pytest.approx(-AWAY, abs=0.1)


@pytest.mark.parametrize("asks", ["stop", "relax"])
def test_the_summary_does_not_judge_a_head_that_was_stopped_or_relaxed(track, asks):
    judged = Judged(track())
    before = judged.after(4.0, 0.0)
    if asks == "stop":
        judged.tracked.world.stop_and_resume()
    else:
        relaxed = Torque.OFF_ON_REQUEST.value
        judged.servos = (ServoStatistics("head_pan_joint", 1, Counters(), torque=relaxed),)
        judged.after(3.0, AWAY)
        judged.servos = ()
    assert judged.after(1.5, AWAY) == pytest.approx(before, abs=0.15)
    largest, later = judged.after(6.0, AWAY)
    assert largest == pytest.approx(AWAY, abs=0.1)
    assert later > before[1] + 2.0


# models, targets, joint states and clocks that are not what they should be


WITHOUT_HEAD = '<robot name="arm"><link name="shoulder"/></robot>'


@pytest.mark.parametrize(
    ("parameters", "urdf", "reason"),
    [
        ({}, "", Blocked.NO_MODEL),
        ({}, WITHOUT_HEAD, Blocked.INVALID_MODEL),
        ({"fixed_frame": "camera_link"}, None, Blocked.INVALID_MODEL),  # it moves with the head
        ({"pointing_frame": "torso_link"}, None, Blocked.INVALID_MODEL),  # it does not
    ],
)
def test_a_model_that_cannot_be_used_is_reported(track, kinectbot, parameters, urdf, reason):
    model = parse_robot_model(urdf) if urdf else kinectbot if urdf is None else None
    tracked = track(model=model, **parameters)
    tracked.see(AWAY, 1.0)
    assert (tracked.fields["state"], tracked.fields["reason"]) == ("idle", reason)
    assert all(frame in tracked.fields["trouble"] for frame in parameters.values())
    assert tracked.world.writes == 0
    if not parameters:
        tracked.world.buffer.core.set_model(kinectbot)
        tracked.world.run(2.0)
        assert tracked.fields["state"] == "tracking"


@pytest.mark.parametrize("kind", [HeadTrackerNode, PointHeadNode])
def test_doctor_knows_all_parameters(track, kind):
    node = track(kind).node
    known = {name for each in HEAD_NODES[node.get_name()] for name in each.__dataclass_fields__}
    rest = [name for name in node._parameters.keys() - known if name[:4] != "qos_"]
    assert {"use_sim_time", "start_type_description_service", "frame_prefix"}.issuperset(rest)


@pytest.mark.parametrize("kind", [HeadTrackerNode, PointHeadNode])
def test_the_status_has_whether_there_is_a_target(track, kind):
    tracked = track(kind)
    found = [tracked.fields["target"]]
    for path in (lambda now: AWAY, None):
        tracked.path = path
        tracked.world.run(0.5)
        if path is None:
            assert tracked.node.control.recenter() is None
            tracked.world.run(0.5)
        found.append(tracked.fields["target"])
    assert found == ["false", "true", "false"]


def test_a_click_in_the_camera_is_not_chased_while_its_place_is_unknown(world):
    mux = world.make(TargetMuxNode, {"fixed_frame": "odom"}, buffer=world.buffer)
    world.make(HeadTrackerNode, {}, loop=world.loop)
    world.run(0.5)
    click = PointStamped(point=Point(x=2.0, y=0.5))
    click.header.frame_id = "camera_link"
    click.header.stamp = mux.get_clock().now().to_msg()
    world.publish("/clicked_point", click)
    world.run(5.0)
    assert abs(world.true_position("head_pan_joint")) < 0.4


def test_sources_that_are_slower_than_their_timeout_and_alternate_are_all_published(world):
    world.make(TargetMuxNode, {"sources": ["a", "b"], "switch_time": 0.0}, buffer=world.buffer)
    published = world.record("/target_point")
    for number in range(12):
        point = PointStamped(point=Point(x=float(1 + number)))
        point.header.frame_id = "base_link"
        world.publish(f"/{'ab'[number % 2]}/target_point", point)
        world.run(0.335)
    assert [message.point.x for _, message in published] == pytest.approx(range(1, 13))


def test_a_turning_base_is_compensated_until_its_odometry_ends_or_is_of_another_clock(track, capfd):
    tracked = track(fixed_frame="odom", recenter_timeout=1.0)
    yaw, lost, ends, ahead = 0.0, math.inf, math.inf, 0
    frames, world = tracked.world.buffer.core, tracked.world

    def drive():
        nonlocal yaw
        yaw = min(yaw + 0.01, 0.8)
        pose = Transform((0.5, 0.0, 0.0), Rotation.from_rpy(0.0, 0.0, yaw))
        if world.stamp < ends:
            frames.set_transform(world.stamp + ahead, "odom", "base_link", pose)
        if world.stamp < lost:
            tracked.node.control.accept(Target(world.stamp, "odom", (3.0, 0.0, 0.8)))

    tracked.node.control.accept(Target(world.stamp, "odom", (3.0, 0.0, 0.8)))
    world.run(2.0)
    assert "odom" in tracked.fields["refusal"]
    world.every(round(STEP * SECOND), drive)
    world.run(1.0)
    assert tracked.fields["state"] == "tracking"
    world.run(2.0)
    assert world.true_position("head_pan_joint") == pytest.approx(-0.8, abs=0.1)
    lost = world.stamp
    world.run(5.0)
    assert tracked.fields["state"] == "idle"
    assert "no transform" not in capfd.readouterr().err
    ends = world.stamp
    world.run(1.5)
    assert "to odom for 1.0 s: the last one is used" in capfd.readouterr().err
    yaw, lost, ends, ahead = -0.8, math.inf, math.inf, 5 * SECOND
    world.run(2.0)
    assert world.true_position("head_pan_joint") == pytest.approx(-yaw, abs=0.3)
    assert tracked.node.control.frames.base.out_of_time(world.stamp / SECOND)


@pytest.mark.parametrize(
    ("is_simulated", "jump", "law"),
    [
        (True, -100.0, ""),
        (True, 100.0, "predictive"),
        (False, -0.5, "predictive"),
        (False, 3600.0, ""),
        (False, -900.0, "speed"),
        (False, 0.7, "position"),
    ],
)
def test_a_jump_of_the_clock_stops_the_head_which_follows_again(track, is_simulated, jump, law):
    tracked = track(law=law) if law else track(PointHeadNode)
    world, world.is_simulated = tracked.world, is_simulated
    tracked.see(AWAY, 3.0)
    tracked.path = None
    world.offset += round(jump * SECOND)
    world.run(0.5)
    stood = world.true_position("head_pan_joint")
    world.run(1.0)
    assert world.true_position("head_pan_joint") == pytest.approx(stood, abs=0.01)
    assert tracked.fields["target"] == "false"
    tracked.see(-AWAY, 4.0)
    assert world.true_position("head_pan_joint") == pytest.approx(-AWAY, abs=0.03)


def test_a_head_that_turns_the_wrong_way_is_disabled_until_it_is_enabled(track, kinectbot):
    tracked = track()
    world, control = tracked.world, tracked.node.control
    states, diagnoses = world.record("/head_tracker/state"), world.record("/diagnostics")
    chain = kinectbot.chain("head_pan_link", "camera_link")

    def see():
        pan, tilt = map(world.true_position, chain.joints)
        point = chain.transform(-pan, tilt).inverse() @ (2.0, 0.6, 0.4)
        seen = Target(world.now, "camera_link", point)
        world.at(world.now + 50_000_000, lambda: control.accept(seen))

    world.every(33_000_000, see)
    world.run(2.5)
    fault = "disabled: head_pan_joint turns in"
    assert states[-1][1].data.startswith(fault)
    assert tracked.fields["enabled"] == "false"
    assert set(world.loop.owners.of(control.joints).values()) == {""}
    newest = diagnoses[-1][1].status[0]
    assert newest.level == DiagnosticStatus.ERROR
    assert "head_pan_joint" in newest.message
    stood = world.true_position("head_pan_joint")
    world.run(1.0)
    assert world.true_position("head_pan_joint") == pytest.approx(stood, abs=0.001)
    control.enable()
    world.run(2.0)
    assert sum(message.data.startswith(fault) for _, message in states) == 2


def test_a_whole_run_uses_simulated_time(make_robot):
    """On a clock that comes 10 times a second and starts anew."""
    robot = make_robot(ros_args=["-p", "use_sim_time:=true"], wait=False)
    states = robot.hear("head_tracker/state", String)
    clock = robot.node.create_publisher(Clock, "/clock", 10)
    wait_for(lambda: states and "/clock is not published" in states[-1].data)
    start, offset = time.monotonic(), 1_000.0

    def publish_clock():
        stamp = Time(nanoseconds=round((time.monotonic() - start + offset) * 1e9))
        clock.publish(Clock(clock=stamp.to_msg()))

    with repeating(publish_clock, period=0.1):
        wait_for(lambda: states[-1].data.startswith("tracking:"))
        offset = 5.0
        wait_for(lambda: any("the clock jumped back" in state.data for state in states))
        wait_for(lambda: states[-1].data.startswith("tracking:"))


@pytest.mark.parametrize("kind", [HeadTrackerNode, PointHeadNode])
@pytest.mark.parametrize(("early", "latency"), [(0.05, 0.0), (0.5, 0.0), (0.5, 0.5)])
def test_what_a_camera_on_the_head_sees_in_the_future_is_refused(track, kind, early, latency):
    tracked = track(kind, target_latency=latency)
    control = tracked.node.control
    for _ in range(30):
        stamp = tracked.world.stamp + round(early * SECOND)
        control.accept(Target(stamp, "camera_optical_frame", (1.0, 0.0, 2.0)))
        tracked.world.run(2 * STEP)
    is_used = early - latency < 0.1
    assert (abs(control.readings.latest.positions[0]) > 0.1) == is_used
    assert ("future" in tracked.fields["refusal"]) != is_used
