"""relax: switches the torque of all servos of a running head off."""

from __future__ import annotations

import argparse
from contextlib import suppress

from diagnostic_msgs.msg import DiagnosticStatus

from head_tracking.cli.client import Client, run_client
from head_tracking.ros.kit.joint_owners import control_from_message
from head_tracking.ros.kit.topics import LATCHED

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
    services: list[str] = []

    def on_control(message: DiagnosticStatus) -> None:
        with suppress(ValueError):  # it is malformed
            control = control_from_message(message)
            if control.node:
                services.append(control.service("relax"))

    client.node.create_subscription(DiagnosticStatus, "joint_control", on_control, LATCHED)
    client.wait_for(
        lambda: bool(services),
        _TIMEOUT,
        "there is no servo bus; is head_tracking running in this ROS_DOMAIN_ID?",
    )
    # of the bus by its own name: a service `relax` may be that of a mobile base
    print(client.call(services, _TIMEOUT))
