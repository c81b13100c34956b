"""Times tf2 in a process and interpreter of its own: ROS 2's if it is there, else Debian's ROS 1.

Reads from standard input: a line with the frames in JSON; then lines "WORK COUNT". Answers each
with the seconds that COUNT repetitions took.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import platform
import sys
import time
from collections.abc import Callable
from typing import Any

try:
    import rclpy.time

    ROS2 = True
except ImportError:
    import rospy

    ROS2 = False
import tf2_ros
from geometry_msgs.msg import PointStamped, PoseStamped, TransformStamped


def stamp(seconds: float) -> Any:
    """A time as lookups want it."""
    if ROS2:
        return rclpy.time.Time(nanoseconds=round(seconds * 1e9))
    return rospy.Time.from_sec(seconds)


def message(parent: str, child: str, seconds: float, numbers: list[float]) -> TransformStamped:
    """One transform: x, y, z and a quaternion."""
    result = TransformStamped()
    time_of = stamp(seconds)
    result.header.stamp = time_of.to_msg() if ROS2 else time_of
    result.header.frame_id, result.child_frame_id = parent, child
    translation, rotation = result.transform.translation, result.transform.rotation
    translation.x, translation.y, translation.z = numbers[:3]
    rotation.x, rotation.y, rotation.z, rotation.w = numbers[3:]
    return result


def new_buffer() -> Any:
    """An empty buffer of 10 s."""
    return tf2_ros.Buffer() if ROS2 else tf2_ros.Buffer(debug=False)


def works(frames: dict[str, Any]) -> dict[str, Callable[[int], float]]:
    """What can be timed, by name; each does it so often and gives the seconds it took."""
    buffer = new_buffer()
    for parent, child, numbers in frames["static"]:
        buffer.set_transform_static(message(parent, child, 0.0, numbers), "benchmark")
    for seconds, parent, child, numbers in frames["sampled"]:
        buffer.set_transform(message(parent, child, seconds, numbers), "benchmark")
    target, source = frames["target"], frames["source"]
    latest, pasts = stamp(0.0), [stamp(seconds) for seconds in frames["past"]]
    point, pose = PointStamped(), PoseStamped()
    point.header.frame_id = pose.header.frame_id = source
    point.point.x = pose.pose.orientation.w = 1.0

    def repeated(work: Callable[..., object], *arguments: Any) -> Callable[[int], float]:
        def repeat(count: int) -> float:
            start = time.perf_counter()
            for _ in range(count):
                work(*arguments)
            return time.perf_counter() - start

        return repeat

    def past(lookup: Callable[..., object]) -> Callable[[int], float]:
        stamps = itertools.cycle(pasts)
        return repeated(lambda: lookup(target, source, next(stamps)))

    other = new_buffer()
    insert = super(tf2_ros.Buffer, other).set_transform
    sample = frames["sampled"][-1]
    clock = [sample[0]]

    def set_transform(count: int) -> float:
        messages = []
        for _ in range(count):
            clock[0] += 0.01
            messages.append(message(sample[1], sample[2], clock[0], sample[3]))
        ahead = iter(messages)
        return repeated(lambda: insert(next(ahead), "benchmark"))(count)

    return {
        "core_latest": repeated(buffer.lookup_transform_core, target, source, latest),
        "core_past": past(buffer.lookup_transform_core),
        "ros_latest": repeated(buffer.lookup_transform, target, source, latest),
        "ros_past": past(buffer.lookup_transform),
        "can": repeated(buffer.can_transform, target, source, latest),
        "ros_point": repeated(buffer.transform, point, target),
        "ros_pose": repeated(buffer.transform, pose, target),
        "set": set_transform,
    }


def main() -> None:
    """Serves until standard input ends."""
    with contextlib.suppress(ImportError):
        import tf2_geometry_msgs  # noqa: F401 - lets tf2_ros transform points
    work = works(json.loads(sys.stdin.readline()))
    release = "2" if ROS2 else "1"
    print(f"ROS {release}'s with Python {platform.python_version()}", flush=True)
    for line in sys.stdin:
        name, count = line.split()
        print(work[name](int(count)), flush=True)


if __name__ == "__main__":
    main()
