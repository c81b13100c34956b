"""Count the functions that process one target point, from its message to the joint command.

A head_tracker node follows a moving target for two seconds. Then it receives one more message, and
the loop runs one more cycle. Only functions of this package are counted.
"""

import collections
import math
import sys
import time
from pathlib import Path
from types import FrameType
from typing import Any

import rclpy
from frame import report, row, table
from geometry_msgs.msg import Point, PointStamped
from rclpy.signals import SignalHandlerOptions

import head_tracking
from head_tracking.control import ControlLoop
from head_tracking.ros.head.head_tracker import HeadTrackerNode
from head_tracking.ros.kit.target_point import target_from_message
from head_tracking.share import robot_file
from head_tracking.tf import Buffer
from head_tracking.transforms import load_robot_model

PACKAGE = str(Path(head_tracking.__file__).parent)


def target_path() -> str:
    """Return the table; report the functions of each file."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    buffer = Buffer()
    buffer.core.set_model(load_robot_model(robot_file("kinectbot")))
    node = HeadTrackerNode(ControlLoop(buffer.core))
    calls: collections.Counter[tuple[str, str]] = collections.Counter()

    def on_event(frame: FrameType, event: str, _: Any) -> None:
        path = frame.f_code.co_filename
        if event == "call" and (path.startswith((PACKAGE, "<")) and not path.startswith("<frozen")):
            # (code that the package compiles at run time, such as its lookups, has no file name)
            calls[path, frame.f_code.co_qualname] += 1

    for k in range(100):
        time.sleep(0.02)
        now = node.get_clock().now()
        buffer.core.set_joint_positions(
            now.nanoseconds, {"head_pan_joint": 0.0, "head_tilt_joint": 0.0}
        )
        bearing = 0.3 * math.sin(0.02 * k)
        message = PointStamped(point=Point(x=2.0 * math.cos(bearing), y=math.sin(bearing), z=0.3))
        message.header.frame_id = "camera_link"
        message.header.stamp = now.to_msg()
        last = k == 99
        sys.setprofile(on_event if last else None)
        node.control.accept(target_from_message(message))
        node.control.update()
        sys.setprofile(None)
    node.destroy_node()
    rclpy.try_shutdown()
    files = sorted({path for path, _ in calls})
    for path in files:
        names = [f"{name} {count}x" for (file, name), count in calls.items() if file == path]
        report(f"{path.removeprefix(PACKAGE + '/')}: {', '.join(sorted(names))}")
    counted = row(len(calls), len(files), calls.total(), "90 functions in 14 files")
    return table("functions | files | calls | asked", [counted])
