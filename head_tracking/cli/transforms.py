"""transforms: shows the frames of a running robot."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from contextlib import suppress

from head_tracking.cli.client import Client, run_client
from head_tracking.command_line import between, seconds
from head_tracking.exceptions import HeadTrackingError
from head_tracking.output import is_output_closed
from head_tracking.transforms import StampedTransform, TransformException


def main() -> int:
    """Run the command; return the exit code."""
    return run_client("transforms", _parse, lambda client, options: options.work(client, options))


def echo(client: Client, options: argparse.Namespace) -> None:
    """Print the transform between two frames periodically, until Ctrl-C."""
    remaining, missed = options.count, 0.0
    with suppress(KeyboardInterrupt):
        while remaining != 0 and not is_output_closed():
            try:
                transform = client.frames.lookup_transform(options.frame, options.of)
            except TransformException:
                missed += 1.0 / options.rate
                if missed > options.wait:
                    raise
            else:
                missed = 0.0
                remaining -= 1
                print(echo_text(transform), flush=True)
            time.sleep(1.0 / options.rate)


def tree(client: Client, options: argparse.Namespace) -> int:
    """Print the tree of all frames with rates and ages."""
    with suppress(HeadTrackingError):
        client.wait_for(lambda: bool(client.frames.frames()), options.wait, "")
        time.sleep(options.listen)  # to measure rates and ages
    text = client.frames.tree_as_string(client.node.get_clock().now().nanoseconds)
    print(text or "no frames")
    return 0 if text else 1


def echo_text(stamped: StampedTransform) -> str:
    """Return a transform as tf2_echo prints it."""

    def listed(numbers: Sequence[float]) -> str:
        return ", ".join(f"{number:.3f}" for number in numbers)

    rotation = stamped.transform.rotation
    rpy = rotation.as_rpy()
    rows = (
        "  " + " ".join(f"{number:6.3f}" for number in row)
        for row in stamped.transform.as_matrix().tolist()
    )
    return "\n".join(
        [
            f"At time {stamped.stamp * 1e-9:.9f}",
            f"- Translation: [{listed(stamped.transform.translation)}]",
            f"- Rotation: in Quaternion (xyzw) [{listed(rotation)}]",
            f"- Rotation: in RPY (radian) [{listed(rpy)}]",
            f"- Rotation: in RPY (degree) [{listed([math.degrees(angle) for angle in rpy])}]",
            "- Matrix:",
            *rows,
        ]
    )


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="transforms",
        description="Shows the frames of a running robot.",
        epilog="ROS arguments follow --ros-args.",
    )
    works = parser.add_subparsers(required=True, metavar="echo | tree")
    echoes = works.add_parser("echo", help="print the transform between two frames")
    echoes.add_argument("frame", metavar="A", help="target frame")
    echoes.add_argument("of", metavar="B", help="source frame: its pose in A is printed")
    echoes.add_argument(
        "--rate", type=between(0.001, 1000.0, "Hz"), default=1.0, help="per second (%(default)s)"
    )
    echoes.add_argument(
        "--count", type=between(1, 1e9, "times", int), default=-1, help="number of times (no limit)"
    )
    trees = works.add_parser("tree", help="print the tree of frames with rates and ages")
    trees.add_argument("--listen", type=seconds, default=2.0, help="in seconds (%(default)s)")
    for command, work in ((echoes, echo), (trees, tree)):
        command.set_defaults(work=work)
        command.add_argument(
            "--wait", type=seconds, default=10.0, help="for the first frame, in s (%(default)s)"
        )
    return parser.parse_args(arguments)
