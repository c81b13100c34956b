"""transforms: shows the frames of a running robot."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from contextlib import suppress

from head_tracking.cli.client import Client, ClientError, running_client
from head_tracking.command_line import above_zero
from head_tracking.ros.kit.start import program, without_ros_arguments
from head_tracking.transforms import StampedTransform, TransformException


@program("transforms")
def main() -> int:
    """Carry out the command line; return the exit code."""
    options = _parse(without_ros_arguments(sys.argv)[1:])
    with running_client("transforms") as client:
        code: int = options.work(client, options)
        return code


def echo(client: Client, options: argparse.Namespace) -> int:
    """Print where a frame is in another one, again and again."""
    left, missed = options.count, 0.0
    while left != 0 and not client.stop():
        try:
            found = client.frames.lookup_transform(options.frame, options.of)
        except TransformException:
            missed += 1.0 / options.rate
            if missed > options.wait:
                raise
        else:
            missed = 0.0
            left -= 1
            print(echo_text(found), flush=True)
        client.stop.wait(1.0 / options.rate)
    return 0


def tree(client: Client, options: argparse.Namespace) -> int:
    """Print all frames, each below its parent, with rates and ages."""
    _listen(client, options)
    text = client.frames.tree_as_string(client.node.get_clock().now().nanoseconds)
    print(text or "no frame is known")
    return 0 if text else 1


def check(client: Client, options: argparse.Namespace) -> int:
    """Print what keeps frames from being looked up."""
    _listen(client, options)
    now = client.node.get_clock().now().nanoseconds
    problems = client.frames.problems(now, round(options.max_age * 1e9))
    for problem in problems:
        print(problem)
    print(
        f"{len(client.frames.frames())} frames within {options.listen:g} s; checked for separate "
        "trees, joints and frames without data, and data older than "
        f"{options.max_age:g} s: {len(problems)} found"
    )
    return 1 if problems else 0


def echo_text(found: StampedTransform) -> str:
    """Return a transform as tf2_echo prints it."""
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


def _listen(client: Client, options: argparse.Namespace) -> None:
    """Wait for the first frame, and then long enough to know rates and ages of all."""
    with suppress(ClientError):
        client.wait_for(lambda: bool(client.frames.frames()), options.wait, "")
        client.stop.wait(options.listen)


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="transforms", description="Shows the frames of a running robot."
    )
    works = parser.add_subparsers(required=True, metavar="echo | tree | check")
    one = works.add_parser("echo", help="print where a frame is in another one")
    one.add_argument("frame", metavar="A", help="the frame to express it in")
    one.add_argument("of", metavar="B", help="the frame that is looked up")
    one.add_argument("--rate", type=above_zero, default=1.0, help="times a second (default 1)")
    one.add_argument("--count", type=int, default=-1, help="end after so many times")
    two = works.add_parser("tree", help="draw all frames, with rates and ages")
    three = works.add_parser("check", help="print what keeps frames from being looked up")
    three.add_argument(
        "--max-age", type=above_zero, default=1.0, help="what is too old, in seconds (default 1)"
    )
    for sub, work in ((one, echo), (two, tree), (three, check)):
        sub.set_defaults(work=work)
        sub.add_argument(
            "--wait", type=above_zero, default=10.0, help="give up without frames after S s (10)"
        )
        if sub is not one:
            sub.add_argument(
                "--listen", type=above_zero, default=2.0, help="listen for S seconds (default 2)"
            )
    return parser.parse_args(arguments)
