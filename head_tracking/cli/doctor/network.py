"""Checks of doctor: clocks and diagnostics of running nodes. It publishes nothing."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from statistics import median
from typing import Any, Final, NamedTuple

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from head_tracking.cli.doctor.findings import Finding, Grade
from head_tracking.ros.kit.spinning import in_short

_TOPICS: Final = {
    "servo_states": JointState,
    "joint_states": JointState,
    "joint_commands": JointState,
    "target_point": PointStamped,
    "/diagnostics": DiagnosticArray,
}
_SKEW: Final = (0.010, 0.100)  # s: amber, red; includes the transport time
_AHEAD: Final = (0.020, 0.002)  # s that a message may be received before it was sent: red, amber
_OLD: Final = (0.3, 1.0)  # s; older points are refused
_OTHER_CLOCK: Final = 1e7  # s


class Times(NamedTuple):
    """Times when a message was sent and received, and its stamp (0: none) [s]."""

    sent: float
    received: float
    stamp: float


class Traffic(NamedTuple):
    """The received messages.

    Attributes:
        times: times of each message, by topic.
        diagnostics: latest level and message of each entry.
        nodes: number of other nodes.
    """

    times: Mapping[str, Sequence[Times]]
    diagnostics: Mapping[str, tuple[int, str]]
    nodes: int


def check_network(arguments: Sequence[str], seconds: float) -> Iterator[Finding]:
    """Listen for some seconds; check clocks, targets and diagnostics.

    Args:
        arguments: ROS arguments, such as --ros-args -r __ns:=/left.
        seconds: how long to listen.
    """
    try:
        received = listen(arguments, seconds)
    except RuntimeError as error:  # rclpy's
        text = f"{in_short(error)}; see `env | grep -E 'ROS|RMW|DDS'` and docs/guide/network.md"
        yield Finding("network", Grade.RED, text)
        return
    yield Finding("network", Grade.GREEN, f"{received.nodes} other nodes")
    yield check_clocks(received.times)
    yield check_targets(received.times.get("target_point", ()))
    for name, (status, message) in sorted(received.diagnostics.items()):
        level = {0: Grade.GREEN, 2: Grade.RED}.get(status, Grade.AMBER)
        yield Finding("diagnostics", level, f"{name}: {message}")


def listen(arguments: Sequence[str], seconds: float) -> Traffic:
    """Receive messages with a silent node; raise RuntimeError if ROS does not start."""
    times: dict[str, list[Times]] = {}
    diagnostics: dict[str, tuple[int, str]] = {}

    def receiver(topic: str) -> Callable[[Any, Any], None]:
        def receive(message: Any, info: Any) -> None:
            stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
            received = (info["received_timestamp"] or time.time_ns()) * 1e-9
            times.setdefault(topic, []).append(
                Times(info["source_timestamp"] * 1e-9, received, stamp)
            )
            for entry in getattr(message, "status", ()):
                diagnostics[entry.name] = (int.from_bytes(entry.level, "little"), entry.message)

        return receive

    rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node("doctor", start_parameter_services=False, enable_rosout=False)
        qos = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
        for topic, kind in _TOPICS.items():
            node.create_subscription(kind, topic, receiver(topic), qos)
        deadline = time.monotonic() + seconds
        while (remaining := deadline - time.monotonic()) > 0.0:
            rclpy.spin_once(node, timeout_sec=remaining)
        return Traffic(times, diagnostics, len(node.get_node_names()) - 1)
    finally:
        rclpy.try_shutdown()


def check_clocks(times: Mapping[str, Sequence[Times]]) -> Finding:
    """Check the clocks of other machines by the fastest message of each topic."""
    skews = {
        topic: min(each.received - each.sent for each in found)
        for topic, found in times.items()
        if all(each.sent > 0.0 for each in found)
    }
    if not skews:
        return Finding("clock skew", Grade.SKIPPED, "no message was received")
    topic = max(skews, key=lambda name: abs(skews[name]))
    skew = skews[topic]
    text = f"{topic} is received at least {1e3 * skew:.1f} ms after it was sent"
    return _graded(
        "clock skew", skew, _SKEW, text, "synchronise the clocks (docs/guide/network.md)"
    )


def check_targets(times: Sequence[Times]) -> Finding:
    """Check the stamps of targets, which must be those of their images."""
    ages = [each.received - each.stamp for each in times if each.stamp]
    if not ages:
        return Finding("stamps of targets", Grade.SKIPPED, "no stamped target_point came")
    age = median(ages)
    if abs(age) > _OTHER_CLOCK:
        text = "not wall-clock times; use_sim_time must be the same in all nodes"
        return Finding("stamps of targets", Grade.AMBER, text)
    text = f"{1e3 * age:.0f} ms old when received"
    advice = "stamp each target with the time of its image; old targets are not followed"
    return _graded("stamps of targets", age, _OLD, text, advice)


def _graded(
    check: str, late: float, limits: tuple[float, float], text: str, advice: str
) -> Finding:
    """Return a finding by how late something is [s]; limits: amber, red."""
    for grade, ahead, limit in zip((Grade.RED, Grade.AMBER), _AHEAD, limits[::-1], strict=True):
        if not -ahead <= late <= limit:
            return Finding(check, grade, f"{text}: {advice}")
    return Finding(check, Grade.GREEN, text)
