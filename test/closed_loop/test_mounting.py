"""Wrongly mounted servos: a camera on the head detects them, and the head stops."""

import math
from collections import deque
from contextlib import closing
from dataclasses import replace

import pytest
import rclpy
import runs
from closed_loop import ClosedLoop, Mounted, ax12
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, PointStamped
from lockstep import World
from rclpy.time import Time
from runs import around, circle, tracker

from head_tracking.ros.head.head_tracker import HeadTrackerNode
from head_tracking.tracking import TargetState

WIDE = (5.0, 3.0)  # rad: a head that turns the wrong way keeps its target in view
ON_HEAD = replace(runs.ON_HEAD, duration=2.0, field=WIDE)


def still(t):
    return around(0.3, 0.4)


class Watched:
    """A tracker; what its joints did and what it said is kept."""

    def __init__(self, head, law="predictive"):
        self.tracker = tracker(head, law)
        self.target_seen = self.tracker.target_seen
        self.joints, self.named, self.commands = [], None, []

    def joints_read(self, stamp, positions):
        self.joints.append((stamp, *positions))
        self.tracker.joints_read(stamp, positions)

    def step(self, now):
        done = self.tracker.step(now)
        self.commands.append((now, done.command))
        if self.tracker.camera.fault and self.named is None:
            self.named = now
        return done

    def moved(self, joint):
        """When that joint had turned by 0.1 rad [s]."""
        first = self.joints[0][1 + joint]
        return next(stamp for stamp, *at in self.joints if abs(at[joint] - first) > 0.1)


def run(head, path, turns, watched, conditions=ON_HEAD):
    mounted = replace(conditions, servos=lambda start: Mounted(ax12()(start), turns))
    ClosedLoop(path, mounted).run(watched)
    return watched


@pytest.mark.parametrize(
    ("law", "turns", "joint", "said"),
    [
        ("position", ((-1, 0), (0, 1)), 0, "head_pan_joint turns in"),
        ("predictive", ((1, 0), (0, -1)), 1, "head_tilt_joint turns in"),
        ("predictive", ((-1, 0), (0, -1)), 0, "head_pan_joint and head_tilt_joint turn in"),
        ("predictive", ((0, 1), (1, 0)), 0, "swapped"),
        ("predictive", ((0, -1), (1, 0)), 0, "swapped"),
        ("predictive", ((0, 1), (-1, 0)), 0, "swapped"),
        ("predictive", ((0, -1), (-1, 0)), 0, "swapped"),
    ],
)
def test_it_is_named_and_the_head_stops(head, law, turns, joint, said):
    watched = run(head, still, turns, Watched(head, law))
    assert said in watched.tracker.machine.reason
    assert watched.tracker.state is TargetState.IDLE
    late = watched.named - watched.moved(joint)
    assert late < 0.4
    standing = [at for stamp, *at in watched.joints if stamp > watched.named + 0.3]
    assert all(math.dist(at, standing[0]) < 0.01 for at in standing)
    assert not any(command for now, command in watched.commands if now > watched.named)


def test_it_goes_on_when_it_restarts_and_says_it_again(head):
    watched, faults = Watched(head), []
    step = watched.step

    def restarting(now):
        done = step(now)
        if watched.tracker.camera.fault and now > 1_001.5 and len(faults) < 2:
            faults.append(watched.tracker.camera.fault)
            watched.tracker.restart()
            assert watched.tracker.camera.fault == ""
            assert watched.tracker.state is TargetState.IDLE
        return done

    watched.step = restarting
    run(head, still, ((-1, 0), (0, 1)), watched, replace(ON_HEAD, duration=3.0))
    assert len(faults) == 2
    assert faults[0] == faults[1] != ""


@pytest.mark.parametrize(("gain", "spell"), [(1.0, 9.0), (3.0, 0.5), (3.0, 9.0)])
def test_a_target_that_runs_from_the_head_is_not_taken_for_that(head, gain, spell):
    """It needs 150 ms to react; it runs for so long [s], and from its first moment on."""
    watched, late, fled = Watched(head), deque(), [0.0]

    def path(t):
        if watched.joints and t < spell:
            late.append((t, watched.joints[-1][1]))
            while late[0][0] < t - 0.15:
                late.popleft()
            fled[0] = gain * late[0][1]
        return around(0.3 + fled[0], 0.4)

    run(head, path, ((1, 0), (0, 1)), watched, replace(ON_HEAD, duration=4.0))
    assert watched.named is None


def test_wrong_stamps_hide_it_from_nobody(head):
    conditions = replace(ON_HEAD, field=(2.0, 2.0), stamp_error=0.09)
    assert run(head, circle, ((0, 1), (1, 0)), Watched(head), conditions).tracker.camera.fault


@pytest.fixture
def world(kinectbot):
    rclpy.init()
    with closing(World(kinectbot)) as world:
        yield world
    rclpy.try_shutdown()


def test_the_node_says_so_and_gives_the_head_up_until_it_is_enabled(world, kinectbot, head):
    node = world.make(HeadTrackerNode, {}, loop=world.loop)
    states, diagnoses = world.record("/head_tracker/state"), world.record("/diagnostics")
    enabled = world.record("/head_tracker/enabled")
    chain = kinectbot.chain(head.base_frame, "camera_link")

    def see():
        true = {joint: world.true_position(joint) for joint in chain.joints}
        true["head_pan_joint"] *= -1.0
        camera = chain.transform(*(true[joint] for joint in chain.joints))
        x, y, z = camera.inverse() @ still(0.0)
        seen = PointStamped(point=Point(x=x, y=y, z=z))
        seen.header.frame_id = "camera_link"
        seen.header.stamp = Time(nanoseconds=world.now).to_msg()
        world.at(world.now + 50_000_000, lambda: world.publish("/target_point", seen))

    world.every(33_000_000, see)
    world.run(2.5)
    assert states[-1][1].data.startswith("disabled: head_pan_joint turns in")
    assert not enabled[-1][1].data
    assert set(world.loop.owners.of(node.control.joints).values()) == {""}
    newest = diagnoses[-1][1].status[0]
    assert newest.level == DiagnosticStatus.ERROR
    assert "head_pan_joint" in newest.message
    stood = world.true_position("head_pan_joint")
    world.run(1.0)
    assert world.true_position("head_pan_joint") == pytest.approx(stood, abs=0.001)
    world.loop.owners.take_over(node.control.name, node.control.joints)
    world.run(2.0)
    assert enabled[-2][1].data
    assert sum(message.data.startswith("disabled: head_pan") for _, message in states) == 2
