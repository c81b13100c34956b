"""head_tracker in simulated time, and the summary of its run."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from lockstep import World
from rclpy.parameter import Parameter

from head_tracking.dynamixel import BusStatistics, BusTiming
from head_tracking.gaze import PointingParameters
from head_tracking.ros.bus.bus_status import BusStatus
from head_tracking.ros.head.head_tracker import HeadTrackerNode
from head_tracking.run.run_monitor import RunMonitor
from head_tracking.tracking import ServoValues, Target
from head_tracking.transforms import RobotModel, parse_robot_model

SECOND = 1_000_000_000  # ns
STEP = 0.02  # s
AWAY = 0.7  # rad


class Tracked:
    """head_tracker, its servos, and a target that is seen 50 times a second.

    Attributes:
        path: the bearing of the target [rad] at a time [s]; None: there is no target.
    """

    def __init__(self, model: RobotModel, **parameters: Any) -> None:
        self.world = world = World(model)
        self.node = world.make(HeadTrackerNode, parameters, loop=world.loop)
        self.path: Callable[[float], float] | None = None
        world.every(round(STEP * SECOND), self._see)
        world.run(0.5)

    def target(self, bearing: float) -> Target:
        point = 2.0 * math.cos(bearing), 2.0 * math.sin(bearing), 0.1
        return Target(self.world.stamp, "torso_link", point)

    def speeds(self, seconds: float) -> list[float]:
        """Return the true speeds of pan while time passes [rad/s]."""
        speeds, before = [], self.world.true_position("head_pan_joint")
        for _ in range(round(seconds / STEP)):
            self.world.run(STEP)
            pan = self.world.true_position("head_pan_joint")
            speeds.append(abs(pan - before) / STEP)
            before = pan
        return speeds

    def stop_and_resume(self) -> None:
        owners = self.world.loop.owners
        owners.stop(dict)
        owners.resume(owners.epoch.value)

    def _see(self) -> None:
        if self.path is not None:
            self.node.control.accept(self.target(self.path(self.world.seconds)))


@pytest.fixture
def track(kinectbot: RobotModel, threads: Any) -> Iterator[Callable[..., Tracked]]:
    made: list[Tracked] = []

    def track(**parameters: Any) -> Tracked:
        made.append(Tracked(kinectbot, **parameters))
        return made[-1]

    yield track
    for tracked in made:
        tracked.node.destroy_node()


def test_a_resumed_head_stays_slow_over_jumps_and_while_there_is_no_target(track):
    tracked = track()
    tracked.stop_and_resume()
    tracked.path = lambda now: AWAY
    assert 0.1 < max(tracked.speeds(0.3)) < 0.35
    tracked.path = None
    for jump in (-900, 3600):
        tracked.world.offset += jump * SECOND
        tracked.world.run(3.0)
    tracked.path = lambda now: -AWAY
    assert 0.1 < max(tracked.speeds(1.0)) < 0.35
    tracked.world.run(6.0)
    tracked.path = lambda now: AWAY
    assert max(tracked.speeds(1.0)) > 1.0


def test_a_resumed_head_keeps_max_joint_speed(track):
    tracked = track(max_joint_speed=0.1)
    tracked.stop_and_resume()
    tracked.path = lambda now: AWAY
    assert 0.05 < max(tracked.speeds(3.0)) < 0.12


def test_a_motion_that_replaces_tracking_does_not_stop_the_head(track):
    """As `Head.look_at` after `Head.follow`."""
    tracked = track()
    begun = tracked.world.seconds
    tracked.path = lambda now: now - begun
    tracked.world.run(1.0)
    p = PointingParameters(max_velocity=1.0)
    tracked.node.control.point(tracked.target(2.0), p, lambda motion: None, at_stamp=True)
    speeds = tracked.speeds(0.2)
    assert speeds[0] > 0.7
    assert min(speeds) > 0.5


PAN_DELAY = "head_pan_joint: delay of its servo"


def turn_to_and_fro(tracked, times=3):
    for k in range(times):
        target = tracked.target(AWAY * (-1) ** k)
        tracked.node.control.point(target, PointingParameters(), lambda motion: None)
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
    assert shown().endswith("not observable, frozen")


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
        status = BusStatus("", BusStatistics(1, 0, 0, ()), BusTiming(50.0, 50.0, 0.0, 0), {})
        world = tracked.world
        self._monitor = RunMonitor(
            tracked.node.control, lambda: status, lambda joint: 0.0, clock=lambda: world.seconds
        )
        world.every(SECOND // 10, self._monitor.update)

    def after(self, seconds: float, bearing: float | None) -> tuple[float, float]:
        """Let time pass; return the largest error [rad] and the judged time [s] of the run."""
        self.tracked.path = None if bearing is None else lambda now: bearing
        self.tracked.world.run(seconds)
        found = re.search(r"([\d.]+)° max .* over ([\d.]+) s", self._monitor.summary())
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
