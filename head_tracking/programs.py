"""The programs that setup.py installs, by name; one that needs ROS says so where there is none."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from typing import Final

_MODULES: Final = {
    "head_tracking": "__main__",
    "servo": "tools.servo.main",
    "doctor": "tools.doctor.__main__",
}
_ROS: Final = ("rclpy", "rcl_interfaces", "builtin_interfaces", "std_srvs", "ament_index_python")

NO_ROS: Final = (
    "ROS 2 is needed, and is not installed here: source it, or pip install 'head_tracking[ros]'; "
    "`from head_tracking import Head` works without"
)


def __getattr__(name: str) -> Callable[[], int]:
    """Return the main function of a program."""
    if name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def main() -> int:
        try:
            program = import_module(f"head_tracking.{_module(name)}")
        except ModuleNotFoundError as error:
            package = (error.name or "").partition(".")[0]
            if package not in _ROS and not package.endswith("_msgs"):
                raise
            print(f"{name}: {NO_ROS} ({package} is missing)", file=sys.stderr)
            return 1
        code: int = program.main()
        return code

    return main


def has_ros() -> bool:
    """Return whether rclpy can be imported."""
    with suppress(ValueError):  # it is hidden
        return find_spec("rclpy") is not None
    return False


def _module(name: str) -> str:
    if name in _MODULES:
        return _MODULES[name]
    is_node = find_spec(f"head_tracking.nodes.{name}") is not None
    return f"nodes.{name}" if is_node else f"tools.{name}"
