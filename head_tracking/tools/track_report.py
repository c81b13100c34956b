"""track_report: records how a head follows its target; writes a picture and a table."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from head_tracking.command_line import seconds, writable_file
from head_tracking.gaze import PanTiltHead
from head_tracking.parameters import parameter
from head_tracking.ros.head_interface import HeadParameters
from head_tracking.ros.messages import target_from_message
from head_tracking.ros.parameters import NodeParameters
from head_tracking.ros.start import program, start_ros, without_ros_arguments
from head_tracking.ros.stop_signal import StopSignal
from head_tracking.run.status_line import StatusLine
from head_tracking.tf import listening_buffer
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.tracking import TargetPlacer, Trace, TrackingJudge, picture, table
from head_tracking.transforms import RobotModelError

_PATIENCE = 10.0  # s for the robot's model to come
_INPUT = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)


@dataclass(frozen=True, slots=True)
class TrackReportParameters:
    """What is pointed."""

    camera_link: str = parameter("camera_link", "The frame that is pointed.", fixed=True)


class TrackReportNode(Node):
    """Listens to targets and joints; judges by the measured joints. Commands nothing."""

    def __init__(self, **options: Any) -> None:
        super().__init__("track_report", **options)
        self._frame = NodeParameters(self, TrackReportParameters).value.camera_link
        self._head_parameters = NodeParameters(self, HeadParameters).value
        self._buffer = listening_buffer(self).core
        self._placer: TargetPlacer | None = None
        self._came: dict[int, float] = {}
        self.targets = 0
        self.head: PanTiltHead | None = None
        self.trace = Trace()
        self.ages: list[float] = []
        self._stamps: list[float] = []
        self._judge: TrackingJudge | None = None
        self.create_subscription(PointStamped, "target_point", self._on_target, _INPUT)
        self.create_subscription(JointState, "joint_states", self._on_joints, 50)

    @property
    def _now(self) -> float:
        return float(self.get_clock().now().nanoseconds) * 1e-9

    def _on_target(self, message: PointStamped) -> None:
        if self.head is None or self._placer is None:
            return
        self.targets += 1
        target = target_from_message(message)
        self._placer.offer(target, self._now)
        self._came[target.stamp] = self._now
        self.place()

    def _on_joints(self, message: JointState) -> None:
        model = self._buffer.model
        p = self._head_parameters
        if self.head is None and model is not None:
            self.head = p.head(model, self._frame)
            self._placer = TargetPlacer(self._buffer, self.head.base_frame, p.transform_timeout)
            self._judge = TrackingJudge(self.head, 0.0, self.trace)
        positions = dict(zip(message.name, message.position, strict=False))
        if self._judge and {p.head_pan_joint, p.head_tilt_joint} <= positions.keys():
            stamp = stamp_to_ns(message.header.stamp) * 1e-9
            pan, tilt = positions[p.head_pan_joint], positions[p.head_tilt_joint]
            self._judge.joints_read(stamp, (pan, tilt))

    @property
    def target_rate(self) -> float:
        """Points a second; 0 with less than two."""
        span = max(self._stamps) - min(self._stamps) if self._stamps else 0.0
        return (len(self._stamps) - 1) / span if span else 0.0

    def place(self) -> None:
        """Notes the targets that can be placed by now."""
        if self._placer is None:
            return
        placed = self._placer.place(self._now, {})
        refusal = self._placer.take_refusal()
        if refusal is not None:
            self.get_logger().warning(
                f"target {refusal.target} left out: {refusal.reason}", throttle_duration_sec=2.0
            )
        for target, point in placed:
            came = self._came.pop(target.stamp, self._now)
            stamp = target.stamp * 1e-9 if target.stamp else came
            self._stamps.append(stamp)
            self.ages.append(came - stamp)
            if self._judge is not None:
                self._judge.target_seen(stamp, point)


@program("track_report")
def main() -> int:
    """Records a run and writes what came of it; returns the exit code."""
    options = _parse(without_ros_arguments(sys.argv)[1:])
    with StopSignal() as stop, ExitStack() as resources:
        start_ros()
        resources.callback(rclpy.try_shutdown)
        node = TrackReportNode()
        resources.callback(node.destroy_node)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        resources.callback(executor.shutdown)
        try:
            return record_run(node, executor, options, stop)
        except RobotModelError as error:
            return _fail(str(error))


def record_run(
    node: TrackReportNode,
    executor: SingleThreadedExecutor,
    options: argparse.Namespace,
    stop: Callable[[], bool],
) -> int:
    """Listens for the time asked for and reports; returns the exit code."""
    end = time.monotonic() + _PATIENCE
    while node.head is None:
        executor.spin_once(timeout_sec=0.05)
        if stop() or time.monotonic() > end:
            return _fail(
                "no robot_description or no joint_states came; is a head running, in this "
                "ROS_DOMAIN_ID? (start one by: head_tracking --sim)"
            )
    began, line = time.monotonic(), StatusLine(sys.stderr)
    while not stop() and (elapsed := time.monotonic() - began) < options.duration:
        executor.spin_once(timeout_sec=0.05)
        line.show(
            [f"recording: {elapsed:.0f} of {options.duration:g} s", f"{node.targets} targets"]
        )
    line.end(f"recorded {time.monotonic() - began:.1f} s, {node.targets} targets")
    node.place()
    trace = node.trace
    if len(trace) < 10:
        return _fail(
            "there was hardly any moment at which both the joints and a target were known; is "
            "somebody publishing target_point?"
        )
    text = table(trace, node.ages, node.target_rate, markdown=options.markdown)
    try:
        options.output.write_text(picture(trace, f"{node.head.pointing_frame} and its target"))
    except OSError as error:  # what was recorded is not lost
        print(text)
        return _fail(f"the picture cannot be written: {error}")
    print(f"{text}\n\nThe picture is {options.output}.")
    return 0


def _fail(reason: str) -> int:
    print(f"track_report: {reason}", file=sys.stderr)
    return 1


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="track_report",
        description="Records how a running head, real or simulated, follows its target, judged by "
        "its measured joints; prints a table and writes a picture (SVG). It commands nothing.",
        epilog="ROS's own arguments follow --ros-args.",
    )
    parser.add_argument(
        "--duration", type=seconds, default=20.0, metavar="S", help="record for S seconds (20)"
    )
    parser.add_argument(
        "--output",
        type=writable_file,
        default="track_report.svg",
        metavar="FILE",
        help="the picture (default: %(default)s)",
    )
    parser.add_argument("--markdown", action="store_true", help="the table for a document")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    raise SystemExit(main())
