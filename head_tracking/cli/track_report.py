"""track_report: records how a head follows its target; writes a picture and a table."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

from geometry_msgs.msg import PointStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from head_tracking.cli.client import Client, ClientError, running_client
from head_tracking.command_line import seconds, writable_file
from head_tracking.head.head_parameters import HeadParameters
from head_tracking.parameters import parameter
from head_tracking.ros.kit.messages import target_from_message
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.start import program, without_ros_arguments
from head_tracking.run.status_line import StatusLine
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.tracking import TargetPlacer, Trace, TrackingJudge, picture, table

_PATIENCE = 10.0  # s for the robot's model and joints to come
_INPUT = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)


@dataclass(frozen=True, slots=True)
class TrackReportParameters:
    """What is pointed."""

    camera_link: str = parameter("camera_link", "The frame that is pointed.", fixed=True)


class FollowedTarget:
    """Targets and measured joints of a running head. Callbacks run in the client's one thread.

    Args:
        client: With a robot whose joints are known.

    Raises:
        RobotModelError: The robot has no such head.
    """

    def __init__(self, client: Client) -> None:
        node = client.node
        self._log, self._clock = node.get_logger(), node.get_clock()
        p = NodeParameters(node, HeadParameters).value
        frame = NodeParameters(node, TrackReportParameters).value.camera_link
        client.wait_for(
            lambda: client.frames.model is not None,
            _PATIENCE,
            "no robot_description is published; is a head running, in this ROS_DOMAIN_ID? "
            "(start one by: head_tracking --sim)",
        )
        assert client.frames.model is not None
        self.head = p.head(client.frames.model, frame)
        self.trace = Trace()
        self.targets = 0
        self.stamps: list[float] = []
        self.ages: list[float] = []
        self._joints = p.head_pan_joint, p.head_tilt_joint
        self._placer = TargetPlacer(client.frames, self.head.base_frame, p.transform_timeout)
        self._judge = TrackingJudge(self.head, 0.0, self.trace)
        self._received: dict[int, float] = {}
        node.create_subscription(PointStamped, "target_point", self._on_target, _INPUT)
        node.create_subscription(JointState, "joint_states", self._on_joints, 50)

    @property
    def rate(self) -> float:
        """Targets per second."""
        span = max(self.stamps) - min(self.stamps) if self.stamps else 0.0
        return (len(self.stamps) - 1) / span if span else 0.0

    def _on_target(self, message: PointStamped) -> None:
        self.targets += 1
        now, target = self._clock.now().nanoseconds * 1e-9, target_from_message(message)
        self._placer.offer(target, now)
        self._received[target.stamp] = now
        self._place(now)

    def _on_joints(self, message: JointState) -> None:
        positions = dict(zip(message.name, message.position, strict=False))
        if set(self._joints) <= positions.keys():
            pan, tilt = (positions[joint] for joint in self._joints)
            self._judge.joints_read(stamp_to_ns(message.header.stamp) * 1e-9, (pan, tilt))
            self._place(self._clock.now().nanoseconds * 1e-9)

    def _place(self, now: float) -> None:
        placed = self._placer.place(now, {})
        refusal = self._placer.take_refusal()
        if refusal is not None:
            self._log.warning(
                f"target {refusal.target} left out: {refusal.reason}", throttle_duration_sec=2.0
            )
        for target, point in placed:
            received = self._received.pop(target.stamp, now)
            stamp = target.stamp * 1e-9 if target.stamp else received
            self.stamps.append(stamp)
            self.ages.append(received - stamp)
            self._judge.target_seen(stamp, point)


@program("track_report")
def main() -> int:
    """Record a run and write the result; return the exit code."""
    options = _parse(without_ros_arguments(sys.argv)[1:])
    with running_client("track_report") as client:
        recording = FollowedTarget(client)
        began, line = time.monotonic(), StatusLine(sys.stderr)
        while not client.stop() and (elapsed := time.monotonic() - began) < options.duration:
            line.show(
                [
                    f"recording: {elapsed:.0f} of {options.duration:g} s",
                    f"{recording.targets} targets",
                ]
            )
            client.stop.wait(0.2)
        line.end(f"recorded {time.monotonic() - began:.1f} s, {recording.targets} targets")
    trace = recording.trace
    if len(trace) < 10:
        raise ClientError(
            "there was hardly any moment at which both the joints and a target were known; is "
            "target_point published?"
        )
    print(table(trace, recording.ages, recording.rate, markdown=options.markdown))
    try:
        title = f"{recording.head.pointing_frame} and its target"
        options.output.write_text(picture(trace, title))
    except OSError as error:
        raise ClientError(f"the picture cannot be written: {error}") from error
    print(f"\nThe picture is {options.output}.")
    return 0


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="track_report",
        description="Records how a running head, real or simulated, follows its target, judged by "
        "its measured joints; prints a table and writes a picture (SVG). It commands nothing.",
        epilog="ROS's own arguments follow --ros-args.",
    )
    add = parser.add_argument
    add("--duration", type=seconds, default=20.0, metavar="S", help="record for S seconds (20)")
    add(
        "--output", type=writable_file, default="track_report.svg", metavar="FILE",
        help="the picture (default: %(default)s)",
    )  # fmt: skip
    add("--markdown", action="store_true", help="the table for a document")
    return parser.parse_args(arguments)
