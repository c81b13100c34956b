"""Checks of doctor: clocks and diagnostics of running nodes. It publishes nothing."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from head_tracking.cli.doctor.findings import Finding, Grade
from head_tracking.exceptions import HeadTrackingError
from head_tracking.ros.kit.spinning import ros_threads
from head_tracking.ros.kit.threads import take_message

_TOPICS: Final = {
    "servo_states": JointState,
    "joint_states": JointState,
    "joint_commands": JointState,
    "target_point": PointStamped,
    "/diagnostics": DiagnosticArray,
}
_POLL: Final = 0.01  # s
_LATE: Final = (0.100, 0.010)  # s after it was sent that a message is received: red, amber
_AHEAD: Final = (0.020, 0.002)  # s before it was sent: red, amber


class Traffic(NamedTuple):
    """The received messages.

    Attributes:
        delays: shortest time between sending and receiving a message [s], by topic.
        diagnostics: latest level and message of each entry.
        nodes: number of other nodes.
    """

    delays: Mapping[str, float]
    diagnostics: Mapping[str, tuple[int, str]]
    nodes: int


def check_network(arguments: Sequence[str], seconds: float) -> Iterator[Finding]:
    """Listen for some seconds with these ROS arguments; check clocks and diagnostics."""
    try:
        received = listen(arguments, seconds)
    except HeadTrackingError as error:
        text = f"{error}; see `env | grep -E 'ROS|RMW|DDS'` and docs/guide/network.md"
        yield Finding("network", Grade.RED, text)
        return
    yield Finding("network", Grade.GREEN, f"{received.nodes} other nodes")
    yield check_clocks(received.delays)
    for name, (status, message) in sorted(received.diagnostics.items()):
        level = {0: Grade.GREEN, 2: Grade.RED}.get(status, Grade.AMBER)
        yield Finding("diagnostics", level, f"{name}: {message}")


def listen(arguments: Sequence[str], seconds: float) -> Traffic:
    """Receive messages with a silent node; raise HeadTrackingError if ROS does not start."""
    delays: dict[str, float] = {}
    diagnostics: dict[str, tuple[int, str]] = {}

    def receive(topic: str, message: Any, about: Mapping[str, Any]) -> None:
        received, sent = about["received_timestamp"] or time.time_ns(), about["source_timestamp"]
        if sent:  # else the middleware does not know
            delays[topic] = min(delays.get(topic, math.inf), (received - sent) * 1e-9)
        for entry in getattr(message, "status", ()):
            diagnostics[entry.name] = (int.from_bytes(entry.level, "little"), entry.message)

    with ros_threads(arguments):
        node = Node("doctor", start_parameter_services=False, enable_rosout=False)
        qos = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
        subscriptions = {
            topic: node.create_subscription(kind, topic, lambda _: None, qos)
            for topic, kind in _TOPICS.items()
        }
        end = time.monotonic() + seconds
        while time.monotonic() < end:  # the EventsExecutor does not know when a message was sent
            for topic, subscription in subscriptions.items():
                while (taken := take_message(subscription)) is not None:
                    receive(topic, *taken)
            time.sleep(_POLL)
        return Traffic(delays, diagnostics, len(node.get_node_names()) - 1)


def check_clocks(delays: Mapping[str, float]) -> Finding:
    """Check the clocks of other machines by the fastest message of each topic [s]."""
    if not delays:
        return Finding("clock skew", Grade.SKIPPED, "no message was received")
    topic = max(delays, key=lambda name: abs(delays[name]))
    delay = delays[topic]
    text = f"{topic} is received at least {1e3 * delay:.1f} ms after it was sent"
    for grade, ahead, late in zip((Grade.RED, Grade.AMBER), _AHEAD, _LATE, strict=True):
        if not -ahead <= delay <= late:
            advice = "synchronise the clocks (docs/guide/network.md)"
            return Finding("clock skew", grade, f"{text}: {advice}")
    return Finding("clock skew", Grade.GREEN, text)
