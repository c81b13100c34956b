"""relax: switches the torque of all servos of a running head off, once."""

from __future__ import annotations

import argparse
import sys

from head_tracking.cli.client import running_client
from head_tracking.ros.kit.start import program, without_ros_arguments

_PATIENCE = 10.0  # s; discovery of a running servo_bus can take a few


@program("relax")
def main() -> int:
    """Relax the servos and return 0 if every one has confirmed."""
    argparse.ArgumentParser(
        prog="relax",
        description="Switch the torque of a running head's servos off. Where no program drives "
        "them: servo --port DEV relax",
        epilog="ROS's own arguments follow --ros-args.",
    ).parse_args(without_ros_arguments(sys.argv)[1:])
    with running_client("relax") as client:
        print(client.call(["relax"], _PATIENCE))
    return 0
