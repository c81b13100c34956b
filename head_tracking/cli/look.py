"""look: turns a running head to a point or a frame, and reports whether it has arrived."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped

from head_tracking.cli.client import Client, run_client
from head_tracking.command_line import point_in_frame, seconds, with_negative_values
from head_tracking.exceptions import HeadTrackingError
from head_tracking.gaze import Arrival
from head_tracking.ros.kit.target_point import target_message
from head_tracking.ros.kit.topics import LATCHED
from head_tracking.tracking import Target
from head_tracking.transforms import LATEST, TransformException

_PERIOD = 0.05  # s
_SETTLE_TIME = 0.3  # s
_TOLERANCE = math.radians(2.0)  # largest miss that counts as arrived


def look(client: Client, options: argparse.Namespace) -> None:
    """Turn the head, wait until it has arrived, and print the miss."""
    frames, head = client.frames, client.head(options.wait)
    joints = head.pan_joint, head.tilt_joint
    client.wait_for(
        lambda: all(frames.latest_joint_position(joint) for joint in joints),
        options.wait,
        f"the positions of {' and '.join(joints)} are not published on joint_states",
    )

    def positions() -> tuple[float, float]:
        pan, tilt = (frames.latest_joint_position(joint) for joint in joints)
        if pan is None or tilt is None:
            raise HeadTrackingError("the clock has jumped, and no joint position has come since")
        return pan[1], tilt[1]

    troubles: dict[str, str] = {}

    def on_status(message: DiagnosticStatus) -> None:
        is_good = message.level == DiagnosticStatus.OK
        troubles[message.name] = "" if is_good else f"; {message.name} is {message.message}"

    for node in ("head_tracker", "point_head"):
        client.node.create_subscription(DiagnosticStatus, f"{node}/status", on_status, LATCHED)
    targets = client.node.create_publisher(PointStamped, "target_point", 10)

    def reasons() -> str:
        count = client.node.count_publishers(targets.topic_name) - 1
        others = f"; {count} other publishers of target_point: end them" if count else ""
        return "".join(troubles.values()) + others

    if options.centre:
        client.call(["head_tracker/recenter", "point_head/recenter"], options.wait)
        centre = head.pan_limits.clamp(0.0), head.tilt_limits.clamp(0.0)
        _wait(options, lambda: math.dist(positions(), centre), reasons)
        return
    point, frame = options.where
    client.wait_for(
        lambda: targets.get_subscription_count() > 0,
        options.wait,
        "no head subscribes to target_point; is head_tracking running in this ROS_DOMAIN_ID?",
    )

    def miss() -> float:
        try:
            seen = frames.transform_point(point, head.base_frame, frame)
        except TransformException as error:
            raise HeadTrackingError(f"the head does not move: {error}") from error
        gaze = head.gaze(seen, *positions())
        if not gaze.reached:
            raise HeadTrackingError(f"the head does not move: {gaze.reason}")
        targets.publish(target_message(Target(LATEST, frame, point)))
        return head.miss(seen, *positions())

    _wait(options, miss, reasons)


def _wait(
    options: argparse.Namespace, miss: Callable[[], float], reasons: Callable[[], str]
) -> None:
    """Call `miss` until the head has arrived."""
    arrival, missed, has_arrived = Arrival(_TOLERANCE, _SETTLE_TIME), math.inf, False
    end = time.monotonic() + options.timeout
    while not has_arrived and time.monotonic() < end:
        missed = miss()
        has_arrived = arrival.step(missed, time.monotonic())
        time.sleep(_PERIOD)
    text = f"the head misses the target by {math.degrees(missed):.2f} degrees"
    if not has_arrived:
        raise HeadTrackingError(f"did not arrive: {text}{reasons()}")
    print(f"arrived: {text}")


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="look",
        description="Turns a running head to a target and reports the miss.",
        epilog="exit codes: 0 arrived; 1 not arrived; 2 wrong command line; 130 Ctrl-C. "
        "ROS arguments follow --ros-args.",
    )
    target = parser.add_mutually_exclusive_group(required=True)
    target.add_argument(
        "where", nargs="?", type=point_in_frame, metavar="x,y,z@frame|@frame",
        help="a point [m] and its frame, such as 1,0.5,0@base_link, or a frame",
    )  # fmt: skip
    target.add_argument("--centre", "--center", action="store_true", help="look straight ahead")
    add = parser.add_argument
    add("--timeout", type=seconds, default=8.0, metavar="S", help="of the turn (%(default)s s)")
    add("--wait", type=seconds, default=10.0, metavar="S", help="for a head (%(default)s s)")
    return parser.parse_args(with_negative_values(arguments))


def main() -> int:
    """Turn the head; return the exit code."""
    return run_client("look", _parse, look)
