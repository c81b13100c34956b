"""The programs that setup.py installs, by name.

setup.py runs this file without the package, so it imports the standard library only.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pkgutil import resolve_name
from typing import Final

NODES: Final = {
    "servo_bus": "ros.bus",
    "joint_state_publisher": "ros.robot",
    "robot_state_publisher": "ros.robot",
    "point_head": "ros.head",
    "head_tracker": "ros.head",
    "fictitious_target": "ros.targets",
    "frame_target": "ros.targets",
    "target_mux": "ros.targets",
    "visual_target": "ros.targets",
    "detection_target": "ros.targets",
    "simulated_camera": "ros.targets",
    "viewer": "page",
    "recorder": "ros.robot",
}
"""The packages of the nodes, by name; see `node_class`."""

TOOLS: Final = (
    "servo",
    "doctor",
    "look",
    "relax",
    "transforms",
    "track_report",
    "check_model",
    "simulated_bus",
    "head_setup",
    "new_robot",
    "calibrate",
)
COMMANDS: Final = (*NODES, *TOOLS)
"""The commands of `head_tracking COMMAND` and `ros2 run head_tracking COMMAND`."""

_MODULES: Final = {
    "head_tracking": "run.supervisor",
    "servo": "cli.servo.main",
    "doctor": "cli.doctor.__main__",
}
_ROS: Final = ("rclpy", "rcl_interfaces", "builtin_interfaces", "std_srvs", "ament_index_python")

NO_ROS: Final = (
    "ROS 2 is needed but not found: source it, or pip install 'head_tracking[ros]' (with the page: "
    "'head_tracking[ros,page]'); `from head_tracking import Head` works without it"
)


def __getattr__(name: str) -> Callable[[], int]:
    """Return the main function of a program."""
    if name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def main() -> int:
        # before NumPy is imported: for small matrices its threads only cost processor time
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        program_name = name
        command = "".join(sys.argv[1:2]).replace("-", "_")  # new-robot is new_robot
        if name == "head_tracking" and command in COMMANDS:
            program_name = command
            del sys.argv[1]
            sys.argv[0] = program_name
        elif name == "head_tracking" and command and not command.startswith("_"):
            commands = ", ".join(COMMANDS)
            print(f"{name}: no command {sys.argv[1]}; there are {commands}", file=sys.stderr)
            return 2
        try:
            place = f"{NODES.get(program_name, 'cli')}.{program_name}"
            program = import_module(f"head_tracking.{_MODULES.get(program_name, place)}")
            spinning = "head_tracking.ros.kit.spinning"
            run = getattr(program, "main", None) or partial(
                import_module(spinning).run_node, resolve_name(node_class(program_name))
            )
        except ModuleNotFoundError as error:
            package = (error.name or "").partition(".")[0]
            if package not in _ROS and not package.endswith("_msgs"):
                raise
            print(f"{program_name}: {NO_ROS} ({package} is missing)", file=sys.stderr)
            return 1
        except KeyboardInterrupt:
            return 130
        from head_tracking.output import tolerate_output_errors

        tolerate_output_errors()
        code: int = run()
        return code

    return main


def has_ros() -> bool:
    """Return whether rclpy can be imported."""
    with suppress(ValueError):  # sys.modules["rclpy"] is None
        return find_spec("rclpy") is not None
    return False


def node_class(name: str) -> str:
    """Return the name of a node's class: head_tracking.ros.bus.servo_bus.ServoBusNode."""
    kind = name.title().replace("_", "") + "Node"
    return f"head_tracking.{NODES[name]}.{name}.{kind}"
