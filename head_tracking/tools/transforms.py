"""transforms: looks at the frames of a running robot."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack

import rclpy
from rclpy.node import Node

from head_tracking.command_line import above_zero
from head_tracking.ros.start import program, start_ros, without_ros_arguments
from head_tracking.ros.stop_signal import StopSignal
from head_tracking.tf import Buffer, TransformListener
from head_tracking.transforms import StampedTransform, TransformException


@program("transforms")
def main() -> int:
    """Does what the command line says; returns the exit code."""
    options = _parse(without_ros_arguments(sys.argv)[1:])
    with StopSignal() as stop, ExitStack() as resources:
        start_ros()
        resources.callback(rclpy.try_shutdown)
        node = Node("transforms", start_parameter_services=False)
        resources.callback(node.destroy_node)
        buffer = Buffer(node=node)
        listener = TransformListener(buffer, node, spin_thread=True)
        resources.callback(listener.unregister)
        code: int = options.work(options, buffer, node, stop)
        return code


def echo(options: argparse.Namespace, buffer: Buffer, node: Node, stop: StopSignal) -> int:
    """Prints where a frame is in another one, again and again."""
    left, missed = options.count, 0.0
    while left != 0 and not stop():
        try:
            found = buffer.core.lookup_transform(options.frame, options.of)
        except TransformException as error:
            missed += 1.0 / options.rate
            if missed > options.wait:
                print(f"transforms: {error}", file=sys.stderr)
                return 1
        else:
            missed = 0.0
            left -= 1
            print(echo_text(found), flush=True)
        stop.wait(1.0 / options.rate)
    return 0


def tree(options: argparse.Namespace, buffer: Buffer, node: Node, stop: StopSignal) -> int:
    """Prints all frames, each below its parent, with rates and ages."""
    _listen(options, buffer, stop)
    text = buffer.core.tree_as_string(node.get_clock().now().nanoseconds)
    print(text or "no frame is known")
    return 0 if text else 1


def check(options: argparse.Namespace, buffer: Buffer, node: Node, stop: StopSignal) -> int:
    """Prints what keeps frames from being looked up."""
    _listen(options, buffer, stop)
    now = node.get_clock().now().nanoseconds
    problems = buffer.core.problems(now, round(options.max_age * 1e9))
    for problem in problems:
        print(problem)
    frames = buffer.core.frames()
    print(
        f"{len(frames)} frames, listened to for {options.listen:g} s: looked for trees that "
        "nothing connects, joints and frames that were never heard of, and what was last heard of "
        f"more than {options.max_age:g} s ago; "
        + (f"{len(problems)} found" if problems else "all of them can be looked up now")
    )
    return 1 if problems else 0


def echo_text(found: StampedTransform) -> str:
    """A transform as tf2_echo prints it."""
    x, y, z = found.transform.translation
    qx, qy, qz, qw = found.transform.rotation
    rpy = found.transform.rotation.as_rpy()
    degrees = [math.degrees(angle) for angle in rpy]
    rows = "\n".join(
        "  " + " ".join(f"{number:6.3f}" for number in row)
        for row in found.transform.as_matrix().tolist()
    )
    return (
        f"At time {found.stamp * 1e-9:.9f}\n"
        f"- Translation: [{x:.3f}, {y:.3f}, {z:.3f}]\n"
        f"- Rotation: in Quaternion (xyzw) [{qx:.3f}, {qy:.3f}, {qz:.3f}, {qw:.3f}]\n"
        f"- Rotation: in RPY (radian) [{rpy[0]:.3f}, {rpy[1]:.3f}, {rpy[2]:.3f}]\n"
        f"- Rotation: in RPY (degree) [{degrees[0]:.3f}, {degrees[1]:.3f}, {degrees[2]:.3f}]\n"
        f"- Matrix:\n{rows}"
    )


def _listen(options: argparse.Namespace, buffer: Buffer, stop: StopSignal) -> None:
    """Waits for the first frame, and then long enough to know rates and ages of all."""
    end = time.monotonic() + options.wait
    while not buffer.core.frames() and time.monotonic() < end and not stop():
        stop.wait(0.05)
    if buffer.core.frames():
        stop.wait(options.listen)


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="transforms", description="Looks at the frames of a running robot."
    )
    works = parser.add_subparsers(required=True, metavar="echo | tree | check")
    one = works.add_parser("echo", help="print where a frame is in another one")
    one.add_argument("frame", metavar="A", help="the frame to express it in")
    one.add_argument("of", metavar="B", help="the frame that is looked for")
    one.add_argument("--rate", type=above_zero, default=1.0, help="times a second (default 1)")
    one.add_argument("--count", type=int, default=-1, help="end after so many times")
    one.add_argument(
        "--wait", type=above_zero, default=10.0, help="give up without it after S seconds (10)"
    )
    one.set_defaults(work=echo)
    two = works.add_parser("tree", help="draw all frames, with rates and ages")
    three = works.add_parser("check", help="say what keeps frames from being looked up")
    for sub, work in ((two, tree), (three, check)):
        sub.add_argument(
            "--listen", type=above_zero, default=2.0, help="listen for S seconds (default 2)"
        )
        sub.add_argument(
            "--wait", type=above_zero, default=10.0, help="give up if none is heard of (10)"
        )
        sub.set_defaults(work=work)
    three.add_argument(
        "--max-age", type=above_zero, default=1.0, help="what is too old, in seconds (default 1)"
    )
    return parser.parse_args(arguments)


if __name__ == "__main__":
    raise SystemExit(main())
