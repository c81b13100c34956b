"""Clocks that jump, stop, or never start, around a node that tracks."""

import math
import time

import pytest
from builtin_interfaces.msg import Time
from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from waiting import repeating, wait_for

from head_tracking.head.obstacle import Obstacle, Reason
from head_tracking.ros.head.head_tracker import HeadTrackerNode
from head_tracking.ros.head.point_head import PointHeadNode


def swinging(now):
    angle = 0.4 * math.sin(2.0 * math.pi * 0.1 * now)
    return 2.0 * math.cos(angle), 2.0 * math.sin(angle), 0.1


def still(now):
    return 2.0, 0.8, 0.1


TARGET = ("torso_link", swinging)
FUTURE = Obstacle(Reason.FUTURE, "head_pan_joint")
NOT_MEASURED = Obstacle(Reason.NOT_MEASURED, "head_pan_joint")


def on_target(head):
    head.until("tracking")
    head.errors.clear()
    wait_for(lambda: len(head.errors) > 30 and max(head.errors[-20:]) < 0.1)


def test_a_resumed_head_stays_slow_over_jumps_and_while_there_is_no_target(make):
    head = make(simulated=True)
    head.until_logged("ready to point")
    interface = head.node.control
    owners = interface._loop.owners
    owners.stop(dict)
    owners.resume(owners.epoch.value)
    head.target = ("torso_link", still)
    wait_for(lambda: head.farthest() > 0.05)
    head.target = None
    for jump, way in ((-3000.0, "back"), (6000.0, "forward")):
        head.offset += jump
        head.until_logged(f"the clock jumped {way}")
    head.travel.clear()
    wait_for(lambda: len(head.travel) > 300)
    head.target = ("torso_link", still)
    wait_for(lambda: head.farthest() > 0.1)
    assert interface.is_cautious
    assert max(head.speeds) <= 0.3001
    on_target(head)
    assert not interface.is_cautious


def test_a_paused_clock_is_reported_and_tracking_resumes(make):
    head = make(simulated=True)
    head.target = TARGET
    on_target(head)
    head.paused = True
    head.until("idle", Reason.CLOCK)
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
    head.target = ("torso_link", still)
    wait_for(lambda: head.errors and head.errors[-1] < 0.02)
    head.target = None
    head.offset -= 100.0
    head.until_logged("the clock jumped back by")
    head.target = ("torso_link", lambda now: (2.0, -0.8, 0.1))
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
