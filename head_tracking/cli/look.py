"""look: turns a running head to a point or a frame, and reports whether it got there."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence

from geometry_msgs.msg import PointStamped

from head_tracking.cli.client import Client, ClientError, running_client
from head_tracking.command_line import PointInFrame, finite, point_in_frame, with_points
from head_tracking.gaze import Arrival, PanTiltHead
from head_tracking.ros.kit.messages import target_message
from head_tracking.ros.kit.start import program, without_ros_arguments
from head_tracking.tracking import Target
from head_tracking.transforms import LATEST, TransformException

_PERIOD = 0.05  # s
_SETTLE_TIME = 0.3  # s


def look(client: Client, options: argparse.Namespace) -> str:
    """Turn the head, wait until it is there, and return how far it misses.

    Raises:
        ClientError: The head did not get there.
        RobotModelError: The robot has no such head.
    """
    joints, frames = (options.pan_joint, options.tilt_joint), client.frames
    client.wait_for(
        lambda: frames.model is not None,
        options.wait,
        "no robot_description is published: is head_tracking running in this domain?",
    )
    assert frames.model is not None
    head = PanTiltHead(frames.model, *joints, options.camera)
    client.wait_for(
        lambda: all(frames.latest_joint_position(joint) for joint in joints),
        options.wait,
        f"the positions of {' and '.join(joints)} are not published on joint_states",
    )

    def positions() -> tuple[float, float]:
        pan, tilt = (frames.latest_joint_position(joint) for joint in joints)
        if pan is None or tilt is None:
            raise ClientError("the clock has jumped; the head has not been measured since")
        return pan[1], tilt[1]

    if options.centre:
        client.call(["head_tracker/recenter", "point_head/recenter"], options.wait)
        centre = head.pan_limits.clamp(0.0), head.tilt_limits.clamp(0.0)
        return _wait(client, options, lambda: math.dist(positions(), centre), lambda: "")

    targets = client.node.create_publisher(PointStamped, options.topic, 10)
    client.wait_for(
        lambda: targets.get_subscription_count() > 0,
        options.wait,
        f"no head listens on {options.topic}: is head_tracking running in this domain?",
    )

    def miss() -> float:
        try:
            point = frames.transform_point(options.point, head.base_frame, options.frame)
        except TransformException as error:
            raise ClientError(f"nothing moves: {error}") from error
        gaze = head.gaze(point, *positions())
        if not gaze.reached:
            raise ClientError(f"nothing moves: {gaze.reason}")
        return head.miss(point, *positions())

    def send() -> str:
        targets.publish(target_message(Target(LATEST, options.frame, options.point)))
        others = client.node.count_publishers(targets.topic_name) - 1
        return f"; {others} other programs publish {options.topic} too" if others else ""

    return _wait(client, options, miss, send)


def _wait(
    client: Client,
    options: argparse.Namespace,
    miss: Callable[[], float],
    send: Callable[[], str],
) -> str:
    """Send the target until the head has arrived, or until Ctrl-C with --follow."""
    arrival = Arrival(options.tolerance, _SETTLE_TIME)
    end = math.inf if options.follow else time.monotonic() + options.timeout
    while True:
        angle = miss()
        text = f"the head misses the target by {math.degrees(angle):.2f} degrees"
        if options.follow and client.stop() and angle <= options.tolerance:
            return f"stopped: {text}"
        if not options.follow and arrival.step(angle, time.monotonic()):
            return f"arrived: {text}"
        others = send()
        if client.stop() or time.monotonic() > end:
            raise ClientError(f"did not arrive: {text}{others}")
        if options.follow and sys.stdout.isatty():
            print(f"\r{text}  ", end="", flush=True)
        client.stop.wait(_PERIOD)


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="look",
        description="Turns a running head and reports whether it got there.",
        epilog="Exit code 0: it looks there. 1: it does not, and the message says why. 2: usage.",
    )
    add = parser.add_argument
    add(
        "where", nargs="*", type=_number_or_point, metavar="x,y,z@frame",
        help="a point [m] and its frame, such as 1,0.5,0@base_link; or X Y Z with --frame",
    )  # fmt: skip
    add("--frame", help="the frame of X Y Z; alone: the frame to look at")
    add("--follow", action="store_true", help="go on until Ctrl-C")
    add("--centre", "--center", action="store_true", help="look straight ahead")
    add(
        "--tolerance", type=_degrees, default=math.radians(2.0), metavar="DEG",
        help="the largest miss that counts as arrived (default 2)",
    )  # fmt: skip
    add("--timeout", type=finite, default=8.0, metavar="S", help="for the turn (default 8)")
    add("--wait", type=finite, default=10.0, metavar="S", help="for a running head (default 10)")
    add("--topic", default="target_point", help="default: %(default)s")
    add("--camera", default="camera_link", help="the frame that is pointed (%(default)s)")
    add("--pan-joint", default="head_pan_joint", help="default: %(default)s")
    add("--tilt-joint", default="head_tilt_joint", help="default: %(default)s")
    options = parser.parse_intermixed_args(with_points(arguments))
    if options.centre == bool(options.where or options.frame):
        parser.error("give a target: x,y,z@frame, --frame alone, or --centre alone")
    points = [one for one in options.where if isinstance(one, PointInFrame)]
    if len(options.where) == len(points) == 1 and options.frame is None:
        options.point, options.frame = points[0]
        return options
    if not options.centre and (points or options.frame is None or len(options.where) not in (0, 3)):
        parser.error("a point needs a frame, such as: look 1,1,0@base_link")
    options.point = tuple(options.where) or (0.0, 0.0, 0.0)
    return options


@program("look")
def main() -> int:
    """Turn the head; return the exit code."""
    options = _parse(without_ros_arguments(sys.argv)[1:])
    with running_client("look") as client:
        print(look(client, options))
    return 0


def _number_or_point(text: str) -> float | PointInFrame:
    return point_in_frame(text) if "@" in text or "," in text else finite(text)


def _degrees(text: str) -> float:
    return math.radians(finite(text))
