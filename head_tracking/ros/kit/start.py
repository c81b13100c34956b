"""Starts ROS for a program; what a person has to mend is said in one line."""

from __future__ import annotations

import functools
import os
import re
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import rclpy
from ament_index_python.packages import get_package_prefix
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.logging import get_logging_directory
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from head_tracking.exceptions import HeadTrackingError
from head_tracking.output import output_may_get_lost
from head_tracking.ros.kit import parameter_sources
from head_tracking.share import share_directory

_PROFILES = {
    "fastrtps": "FASTRTPS_DEFAULT_PROFILES_FILE",
    "fastdds": "FASTDDS_DEFAULT_PROFILES_FILE",
}
"""Where Fast DDS 2 and 3 look for settings; 3 warns of the name of 2."""


class StartError(HeadTrackingError):
    """ROS does not take its arguments, or a file that they name."""


def start_ros(arguments: Sequence[str] | None = None) -> None:
    """`rclpy.init`, without its signal handlers.

    Where no log file can be written none is, and that is said. Fast DDS gets config/fastdds.xml,
    unless the user has settings of their own.

    Args:
        arguments: the command line; None: `sys.argv`.

    Raises:
        StartError: an argument of ROS or a parameter file is malformed; says which and where.
    """
    arguments = list(sys.argv if arguments is None else arguments)
    reason = _why_no_log_file()
    if reason:
        print(f"no log file is written: {reason}", file=sys.stderr)
        arguments += ["--ros-args", "--disable-external-lib-logs", "--"]
    if not any(map(os.environ.get, _PROFILES.values())):
        settings = str(share_directory() / "config/fastdds.xml")
        os.environ.update({_PROFILES[name]: settings for name in _fast_dds()})
    try:
        with parameter_sources.rules_in_namespace(arguments) as accepted:
            rclpy.init(args=accepted, signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.RCLError as error:
        raise StartError(in_short(error)) from error
    parameter_sources.remember(arguments)


def _fast_dds() -> list[str]:
    """Which Fast DDS is installed beside ROS."""
    try:
        share = Path(get_package_prefix("rmw_fastrtps_cpp")) / "share"
    except (LookupError, OSError):  # another middleware; or AMENT_PREFIX_PATH is not set
        return []
    return [name for name in _PROFILES if (share / name).is_dir()]


def without_ros_arguments(arguments: Sequence[str]) -> list[str]:
    """What is left for the program itself; the first one is its name.

    Raises:
        StartError: an argument of ROS is malformed.
    """
    try:
        return list(remove_ros_args(list(arguments)))
    except rclpy_implementation.RCLError as error:
        raise StartError(in_short(error)) from error


def program(name: str) -> Callable[[Callable[[], int]], Callable[[], int]]:
    """Makes a tool's main function end by one line and 1 if a person can mend what went wrong."""

    def made(main: Callable[[], int]) -> Callable[[], int]:
        @functools.wraps(main)
        def run() -> int:
            with output_may_get_lost():
                try:
                    return main()
                except HeadTrackingError as error:
                    print(f"{name}: {error}", file=sys.stderr)
                    return 1

        return run

    return made


def _why_no_log_file() -> str:
    """Return why ROS's log folder cannot be written; empty if it can."""
    try:
        folder = get_logging_directory()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except (OSError, RuntimeError) as error:  # RuntimeError: HOME is not set
        return f"{error}; set ROS_LOG_DIR to a folder that can be written"


def in_short(error: Exception) -> str:
    """ROS's message in one line, without the places in its own source."""
    text = re.sub(r", at /\S+\.c(pp)?:\d+", "", str(error))
    text = re.sub(r"^failed to initialize \w+: |^Failed to parse ROS arguments: ", "", text)
    return " ".join(text.split())
