"""track_report: records how a head follows its target; prints a table and writes a plot."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from contextlib import suppress

from geometry_msgs.msg import PointStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from head_tracking.cli.client import Client, run_client
from head_tracking.cli.terminal import Terminal
from head_tracking.command_line import seconds, writable_file
from head_tracking.exceptions import HeadTrackingError
from head_tracking.ros.kit.target_point import target_from_message
from head_tracking.share import write_file
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.tracking import TargetPlacer, Trace, TrackingJudge, picture, table

_TIMEOUT = 10.0  # s for the robot's model, and for the first target
_PATIENCE = 1.0  # s that a target waits for its transforms
_STEP = 0.2  # s between two steps of the progress bar
_FEWEST_SAMPLES = 10
_QOS = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)


class TrackRecording:
    """Records targets and measured joints of a running head.

    Raises:
        HeadTrackingError: no robot model is published.
        RobotModelError: the robot has no such head.

    Attributes:
        ages: age of each target when it was received [s].
    """

    def __init__(self, client: Client) -> None:
        self._clock = client.node.get_clock()
        self.head = client.head(_TIMEOUT)
        self.trace = Trace()
        self.ages: list[float] = []
        self._stamps: list[float] = []
        self._placer = TargetPlacer(client.frames, self.head.base_frame, _PATIENCE)
        self._judge = TrackingJudge(self.head, 0.0, self.trace)
        client.node.create_subscription(PointStamped, "target_point", self._on_target, _QOS)
        client.node.create_subscription(JointState, "joint_states", self._on_joints, _QOS)

    @property
    def rate(self) -> float:
        """Targets per second."""
        span = max(self._stamps, default=0.0) - min(self._stamps, default=0.0)
        return (len(self._stamps) - 1) / span if span else 0.0

    @property
    def _now(self) -> float:
        return float(self._clock.now().nanoseconds * 1e-9)

    def _on_target(self, message: PointStamped) -> None:
        target, now = target_from_message(message), self._now
        stamp = target.stamp * 1e-9 if target.stamp else now
        self._stamps.append(stamp)
        self.ages.append(now - stamp)
        self._placer.offer(target, now)
        self._judge_targets()

    def _on_joints(self, message: JointState) -> None:
        positions = dict(zip(message.name, message.position, strict=False))
        joints = self.head.pan_joint, self.head.tilt_joint
        if set(joints) <= positions.keys():
            pan, tilt = (positions[joint] for joint in joints)
            self._judge.joints_read(stamp_to_ns(message.header.stamp) * 1e-9, (pan, tilt))
            self._judge_targets()

    def _judge_targets(self) -> None:
        now = self._now
        for target, point in self._placer.place(now, {}):
            self._judge.target_seen(target.stamp * 1e-9 if target.stamp else now, point)


def main() -> int:
    """Record a run and write the report; return the exit code."""
    return run_client("track_report", _parse, _report)


def _report(client: Client, options: argparse.Namespace) -> None:
    recording = TrackRecording(client)
    client.wait_for(lambda: bool(recording.ages), _TIMEOUT, "no target_point is published")
    steps = range(max(1, round(options.duration / _STEP)))
    with suppress(KeyboardInterrupt):
        for _ in Terminal().track(steps, "recording"):
            time.sleep(_STEP)
    trace = recording.trace.between(-math.inf)  # more samples may come
    if len(trace) < _FEWEST_SAMPLES:
        raise HeadTrackingError(
            f"joints and target were known at {len(trace)} moments only, {_FEWEST_SAMPLES} are "
            "needed; are joint_states and target_point published?"
        )
    print(table(trace, recording.ages, recording.rate))
    title = f"{recording.head.pointing_frame} and its target"
    write_file(options.output, picture(trace, title))
    print(f"\nplot: {options.output}")


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="track_report",
        description="Records how a running head follows its target, by its measured joints; prints "
        "a table and writes a plot (SVG). It commands nothing.",
        epilog="ROS arguments follow --ros-args.",
    )
    add = parser.add_argument
    add("--duration", type=seconds, default=20.0, metavar="S", help="in seconds (%(default)s)")
    add(
        "--output", type=writable_file, default="track_report.svg", metavar="FILE",
        help="the plot (default: %(default)s)",
    )  # fmt: skip
    return parser.parse_args(arguments)
