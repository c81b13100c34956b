"""relax: switches the torque of all servos of a running head off."""

from __future__ import annotations

import argparse

from head_tracking.cli.client import Client, run_client

_TIMEOUT = 10.0  # s; the discovery of a running servo_bus can take some seconds


def main() -> int:
    """Relax the servos; return 0 if each of them has confirmed."""
    parser = argparse.ArgumentParser(
        prog="relax",
        description="Switch the torque of a running head's servos off. If no program runs: "
        "head_tracking servo --port DEV relax",
        epilog="ROS arguments follow --ros-args.",
    )
    return run_client("relax", parser.parse_args, _relax)


def _relax(client: Client, _: argparse.Namespace) -> None:
    print(client.call(["servo_bus/relax", "relax"], _TIMEOUT))
