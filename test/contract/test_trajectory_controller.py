"""A head that a joint_trajectory_controller drives: it is followed, held by STOP, and resumed."""

import math
import time

import pytest
from rig import DEGREE, JOINTS
from sensor_msgs.msg import JointState
from waiting import wait_for

trajectory_msgs = pytest.importorskip("trajectory_msgs.msg")
PERIOD = 0.02  # s
DRIVEN = ("--ros-args", "-p", "command_interface:=joint_trajectory")


class TrajectoryController:
    """Stands in for joint_trajectory_controller: the joints go where the latest trajectory ends.

    Attributes:
        positions: of pan and tilt [rad].
        travel: pan in every period [rad].
        trajectories: what it has received.
        is_stamped: whether its joint_states have stamps.
    """

    def __init__(self, node):
        self.positions, self.travel, self.trajectories = [0.0, 0.0], [], []
        self.is_stamped = True
        self._clock = node.get_clock()
        self._states = node.create_publisher(JointState, "joint_states", 10)
        node.create_subscription(
            trajectory_msgs.JointTrajectory,
            "head_controller/joint_trajectory",
            self.trajectories.append,
            10,
        )
        node.create_timer(PERIOD, self._step)

    def _step(self):
        if self.trajectories:
            self.positions = list(self.trajectories[-1].points[0].positions)
        self.travel.append(self.positions[0])
        # ros2_control's joint_state_broadcaster: the position of a wheel is not measured
        message = JointState(name=[*JOINTS, "wheel"], position=[*self.positions, math.nan])
        if self.is_stamped:
            message.header.stamp = self._clock.now().to_msg()
        self._states.publish(message)


@pytest.mark.parametrize("name", ["head_tracker", "point_head"])
def test_a_trajectory_controller_is_driven_held_by_stop_and_resumed(bench, person, name):
    driven = TrajectoryController(person.node)
    bench.start("robot_state_publisher")
    bench.start(name, *DRIVEN)

    def looks_left(sign):
        return lambda: driven.positions[0] == pytest.approx(sign * math.atan2(1, 2), abs=DEGREE)

    person.keep_looking(2, 1, 0.5, looks_left(1))
    message = driven.trajectories[-1]
    assert tuple(message.joint_names) == JOINTS
    assert (message.header.stamp.sec, message.points[0].time_from_start.nanosec) == (0, 0)
    person.keep_looking(2, -1, 0.5, lambda: driven.positions[0] < 0.3)
    answer = person.call("stop")
    assert not answer.success  # it cannot relax the joints
    assert JOINTS[0] in answer.message
    wait_for(lambda: person.stopped)
    driven.travel.clear()
    person.keep_looking(2, -1, 0.5, lambda: len(driven.travel) > 10)  # what was on its way
    count = len(driven.trajectories)
    person.keep_looking(2, -1, 0.5, lambda: len(driven.travel) > 50)
    assert len(driven.trajectories) == count
    assert max(driven.travel) - min(driven.travel) < 0.2
    person.until_done("resume")
    way, began = driven.positions[0] + math.atan2(1, 2), time.monotonic()
    person.keep_looking(2, -1, 0.5, looks_left(-1))
    # 0.3 rad/s after a stop; a trajectory ends a little ahead of the joint
    assert time.monotonic() - began > (abs(way) - 0.1) / 0.4


def test_a_driver_without_stamps_is_not_only_called_silent(bench, person):
    TrajectoryController(person.node).is_stamped = False
    bench.start("robot_state_publisher")
    bench.start("head_tracker", *DRIVEN)
    wait_for(lambda: "another clock" in str(person.latched("head_tracker/state")))


def test_a_simulated_run_ends_for_it_and_moves_nothing(bench, person):
    first = bench.start("head_tracking", "--sim")
    wait_for(lambda: person.state("head_tracker") == "tracking")
    driven = TrajectoryController(person.node)
    bench.start("robot_state_publisher")
    bench.start("head_tracker", *DRIVEN)
    assert first.end() == 1, first.output
    later = bench.start("head_tracking", "--sim")
    assert later.end() == 1, later.output
    assert not driven.trajectories
