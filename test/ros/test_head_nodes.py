"""The nodes that turn a head, when models, targets or clocks are not what they should be."""

import math
import time

import pytest
from builtin_interfaces.msg import Time
from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from waiting import repeating, wait_for

from head_tracking.head.obstacle import Blocked, Obstacle
from head_tracking.ros.head.head_tracker import HeadTrackerNode
from head_tracking.ros.head.point_head import PointHeadNode
from head_tracking.transforms import Rotation, Transform

WITHOUT_HEAD = '<robot name="arm"><link name="shoulder"/></robot>'


def at(x, y, z, frame="torso_link"):
    return frame, lambda now: (x, y, z)


LEFT, RIGHT = at(2.0, 1.0, 0.1), at(2.0, -1.0, 0.1)


def another(urdf):
    """The same robot, said again in other words."""
    return urdf.replace("</robot>", "<!-- another one --></robot>")


def test_a_disabled_tracker_stays_disabled_with_another_model(make, kinectbot):
    head = make()
    head.until("idle", "")
    assert head.call("head_tracker/enable", False).success
    head.until("disabled", Blocked.DISABLED)
    head.target = LEFT
    head.describe(another(kinectbot.urdf))
    wait_for(lambda: sum("ready to point" in text for text in head.log) >= 2)
    head.travel.clear()
    wait_for(lambda: len(head.travel) > 50)
    assert head.commands <= 1
    assert head.farthest() == 0.0
    assert head.fields["state"] == "disabled"
    assert head.call("head_tracker/enable", True).success
    head.until("tracking")


def test_an_invalid_first_model_is_reported_until_another_is_received(make, kinectbot):
    head = make(urdf=WITHOUT_HEAD)
    head.until("idle", Blocked.INVALID_MODEL, "head_pan_joint")
    head.describe(kinectbot.urdf)
    head.target = LEFT
    head.until("tracking")


@pytest.mark.parametrize(
    ("name", "frame"), [("fixed_frame", "camera_link"), ("pointing_frame", "torso_link")]
)
def test_a_frame_that_the_head_can_not_use_is_refused(make, name, frame):
    """A fixed frame that moves with the head, and a pointing frame that does not."""
    head = make(**{name: frame})
    head.until("idle", Blocked.INVALID_MODEL, frame)
    head.target = LEFT
    head.until_logged(frame)
    assert head.commands == 0


def test_a_missing_model_is_reported(make, kinectbot):
    head = make(urdf="")
    head.target = LEFT
    head.until("idle", Blocked.NO_MODEL)
    head.until_logged("robot_description")


@pytest.mark.parametrize("node", [HeadTrackerNode, PointHeadNode])
def test_the_status_has_whether_there_is_a_target(make, node):
    head = make(node)
    wait_for(lambda: head.fields.get("target") == "false")
    head.target = LEFT
    wait_for(lambda: head.fields["target"] == "true")
    head.target = None
    head.travel.clear()
    wait_for(lambda: len(head.travel) > 5)  # what was sent has come
    assert head.node.control.recenter() is None
    wait_for(lambda: head.fields["target"] == "false")


def test_targets_with_stamps_in_the_future_are_refused(make):
    head = make()
    head.target = LEFT
    head.until("tracking")
    head.target = None
    head.until("holding")
    frame, path = LEFT
    stamp = head.now + 30.0
    for k in range(60):  # nobody knows the joints of that time
        head.send(frame, path(0.0), stamp + k)
        time.sleep(0.03)
    wait_for(lambda: "future" in head.fields["refusal"])
    head.until("holding")


def test_a_turning_base_is_compensated_in_the_fixed_frame(make):
    head = make(fixed_frame="odom")
    yaw = 0.0

    def drive():
        nonlocal yaw
        yaw = min(yaw + 0.01, 0.8)
        pose = Transform((0.5, 0.0, 0.0), Rotation.from_rpy(0.0, 0.0, yaw))
        head.buffer.set_transform(round(head.now * 1e9), "odom", "base_link", pose)

    head.target = at(3.0, 0.0, 0.8, "odom")
    wait_for(lambda: "odom" in head.fields["refusal"])
    head.each_period = drive
    head.until("tracking")
    wait_for(lambda: yaw == 0.8)
    head.errors.clear()
    wait_for(lambda: len(head.errors) > 30 and max(head.errors[-20:]) < 0.03)
    assert head.positions[0] == pytest.approx(-0.8, abs=0.1)


# clocks that jump, stop, or never start


def swinging(now):
    angle = 0.4 * math.sin(2.0 * math.pi * 0.1 * now)
    return 2.0 * math.cos(angle), 2.0 * math.sin(angle), 0.1


TARGET = ("torso_link", swinging)
FUTURE = Obstacle(Blocked.FUTURE, "head_pan_joint")
NOT_MEASURED = Obstacle(Blocked.NOT_MEASURED, "head_pan_joint")


def on_target(head):
    head.until("tracking")
    head.errors.clear()
    wait_for(lambda: len(head.errors) > 30 and max(head.errors[-20:]) < 0.1)


def test_a_paused_clock_is_reported_and_tracking_resumes(make):
    head = make(simulated=True)
    head.target = TARGET
    on_target(head)
    head.paused = True
    head.until("idle", Blocked.CLOCK)
    head.travel.clear()
    head.paused = False
    on_target(head)
    assert head.farthest() < 1.2


def test_joint_states_from_the_future_are_not_fresh(make):
    head = make()
    head.stamped_ahead = 5.0
    head.target = TARGET
    wait_for(lambda: head.node.control.trouble == FUTURE)
    assert head.commands == 0
    assert head.positions == [0.0, 0.0]


def test_old_joint_states_are_not_used_after_the_clock_jumps_back(make):
    head = make(simulated=True)
    head.target = TARGET
    on_target(head)
    head.measured = False
    wait_for(lambda: head.node.control.trouble == NOT_MEASURED)
    commands = head.commands
    head.offset -= 0.7 + 0.5  # the last sample lies a little before the time as it is now
    head.states.clear()
    wait_for(lambda: any("the clock jumped" in text for text in head.log))
    before = head.commands
    time.sleep(0.5)
    assert head.commands - before <= 1
    assert before - commands <= 1


class Settable:
    """The machine's clock, as if somebody set it."""

    ros_time_is_active = False

    def __init__(self, clock):
        self._clock, self.offset = clock, 0.0

    def now(self):
        return self._clock.now() + Duration(seconds=self.offset)

    def create_jump_callback(self, *_, **__):
        """Nobody is told."""


class NodeOnSettableClock(HeadTrackerNode):
    def get_clock(self):
        if not hasattr(self, "settable"):
            self.settable = Settable(super().get_clock())
        return self.settable


@pytest.mark.parametrize(
    ("rate", "jump"),
    [(10.0, -100.0), (50.0, 100.0), (0.0, -0.5), (0.0, 3600.0)],
)
def test_a_jump_of_the_clock_stops_the_head_and_tracking_resumes(make, rate, jump):
    """Of /clock with a rate [Hz], or of the system's, as by NTP: no time source tells of it."""
    head = make(HeadTrackerNode if rate else NodeOnSettableClock, simulated=rate > 0.0)
    head.clock_rate = rate
    head.target = TARGET
    on_target(head)
    head.target = None
    head.states.clear()
    head.offset += jump
    if not rate:
        head.node.get_clock().offset += jump
    wait_for(lambda: any("the clock jumped" in state for state in head.states))
    head.travel.clear()
    wait_for(lambda: len(head.travel) > 40)
    assert head.farthest() < 0.1
    assert head.fields["state"] == "idle"
    head.target = TARGET
    head.travel.clear()
    on_target(head)
    assert head.farthest() < 1.2  # it did not swing to its limit on the way


def test_point_head_restarts_after_a_jump_of_the_clock(make):
    head = make(PointHeadNode, simulated=True)
    wait_for(lambda: head.log and any("ready to point" in text for text in head.log))
    head.target = LEFT
    wait_for(lambda: head.errors and head.errors[-1] < 0.02)
    head.target = None
    head.offset -= 100.0
    head.until_logged("the clock jumped back by")
    head.target = RIGHT
    wait_for(lambda: head.positions[0] < -0.3)


def test_a_whole_run_uses_simulated_time(make_robot):
    """A whole run, on a clock that comes 10 times a second and starts anew."""
    robot = make_robot(ros_args=["-p", "use_sim_time:=true"], wait=False)
    states = robot.hear("head_tracker/state", String)
    clock = robot.node.create_publisher(Clock, "/clock", 10)
    wait_for(lambda: states and "/clock is not published" in states[-1].data)
    start = time.monotonic()
    offset = 1_000.0

    def tell():
        nanoseconds = round((time.monotonic() - start + offset) * 1e9)
        stamp = Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        clock.publish(Clock(clock=stamp))

    with repeating(tell, period=0.1):
        wait_for(lambda: states[-1].data.startswith("tracking:"), 20.0)
        offset = 5.0
        wait_for(lambda: any("the clock jumped back" in state.data for state in states))
        wait_for(lambda: states[-1].data.startswith("tracking:"), 20.0)
