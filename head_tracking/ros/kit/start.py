"""Initialisation of ROS for a program, with errors of one line."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import rclpy
from ament_index_python.packages import get_package_prefix
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.logging import get_logging_directory
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from head_tracking.exceptions import HeadTrackingError
from head_tracking.ros.kit import parameter_sources
from head_tracking.share import share_directory

_PROFILES = {
    "fastrtps": "FASTRTPS_DEFAULT_PROFILES_FILE",
    "fastdds": "FASTDDS_DEFAULT_PROFILES_FILE",
}
"""The variables of Fast DDS 2 and 3 for their settings; 3 warns of that of 2."""


class StartError(HeadTrackingError):
    """ROS refuses its arguments, or a file that they name."""


def start_ros(arguments: Sequence[str] | None = None) -> None:
    """Call `rclpy.init` without its signal handlers.

    If no log file can be written, a warning is printed. Fast DDS uses config/fastdds.xml unless the
    user has other settings.

    Args:
        arguments: the command line; None: `sys.argv`.

    Raises:
        StartError: an argument of ROS or a parameter file is malformed.
    """
    # rosidl_generator_py does without its generator, whose parser takes 7 MB and 0.1 s
    sys.modules.setdefault("rosidl_generator_py.generate_py_impl", None)  # type: ignore[arg-type]
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
    """Return the keys of `_PROFILES` for the installed Fast DDS."""
    try:
        share = Path(get_package_prefix("rmw_fastrtps_cpp")) / "share"
    except (LookupError, OSError):  # another middleware; or AMENT_PREFIX_PATH is not set
        return []
    return [name for name in _PROFILES if (share / name).is_dir()]


def without_ros_arguments(arguments: Sequence[str]) -> list[str]:
    """Return the arguments of the program itself; the first one is its name.

    Raises:
        StartError: an argument of ROS is malformed.
    """
    try:
        return list(remove_ros_args(list(arguments)))
    except rclpy_implementation.RCLError as error:
        raise StartError(in_short(error)) from error


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
    """Return the message of an error of ROS in one line, without places in its source."""
    text = re.sub(r", at /\S+\.c(pp)?:\d+", "", str(error))
    text = re.sub(r"^failed to initialize \w+: |^Failed to parse ROS arguments: ", "", text)
    return " ".join(text.split())
