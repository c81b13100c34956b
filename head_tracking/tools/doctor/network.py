"""doctor listens to the nodes that run: clocks, diagnostics, who commands. It says nothing."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any, Final

from head_tracking.tools.doctor.findings import Finding, Level

_WATCHED: Final = {
    "servo_states": "sensor_msgs/JointState",
    "joint_states": "sensor_msgs/JointState",
    "joint_commands": "sensor_msgs/JointState",
    "target_point": "geometry_msgs/PointStamped",
    "/diagnostics": "diagnostic_msgs/DiagnosticArray",
}
_SKEW: Final = (0.010, 0.100)  # s: amber, red; the path of a message is part of it
_AHEAD: Final = (0.002, 0.020)  # s that a message may seem to come before it was sent
_OLD: Final = (0.3, 1.0)  # s; a target_timeout of 1 s is usual
_OTHER_CLOCK: Final = 1e7  # s


@dataclass(frozen=True, slots=True)
class Heard:
    """What was heard within some time.

    Attributes:
        nodes: The nodes that were there, with their namespaces.
        sent: For each topic, when each message was sent, when it came, and its stamp, all on the
            wall clocks of the two machines, ns; the stamp None where a message has none.
        commanders: Who publishes joint_commands.
        diagnostics: The newest level and message of each entry.
    """

    nodes: tuple[str, ...] = ()
    sent: Mapping[str, Sequence[tuple[int, int, int | None]]] = field(default_factory=dict)
    commanders: tuple[str, ...] = ()
    diagnostics: Mapping[str, tuple[int, str]] = field(default_factory=dict)


def listen(arguments: Sequence[str], seconds: float) -> Heard:
    """Listen with a node that publishes nothing.

    Args:
        arguments: ROS's own, such as --ros-args -r __ns:=/left.
        seconds: How long.
    """
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import PointStamped
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from rclpy.signals import SignalHandlerOptions
    from sensor_msgs.msg import JointState

    kinds = {
        "sensor_msgs/JointState": JointState,
        "geometry_msgs/PointStamped": PointStamped,
        "diagnostic_msgs/DiagnosticArray": DiagnosticArray,
    }
    sent: dict[str, list[tuple[int, int, int | None]]] = {}
    diagnostics: dict[str, tuple[int, str]] = {}

    def hear(topic: str, message: Any, info: Any) -> None:
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        came = info["received_timestamp"] or time.time_ns()
        sent.setdefault(topic, []).append((info["source_timestamp"], came, stamp or None))
        if topic == "/diagnostics":
            for entry in message.status:
                diagnostics[entry.name] = (int.from_bytes(entry.level, "little"), entry.message)

    def hearer(topic: str) -> Any:
        def callback(message: Any, info: Any) -> None:
            hear(topic, message, info)

        return callback

    context = rclpy.Context()
    rclpy.init(
        args=list(arguments), context=context, signal_handler_options=SignalHandlerOptions.NO
    )
    try:
        node = rclpy.create_node(
            "doctor", context=context, start_parameter_services=False, enable_rosout=False
        )
        qos = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
        for topic, kind in _WATCHED.items():
            node.create_subscription(kinds[kind], topic, hearer(topic), qos)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        deadline = time.monotonic() + seconds
        while (rest := deadline - time.monotonic()) > 0.0:
            executor.spin_once(timeout_sec=rest)
        nodes = sorted(
            f"{space.rstrip('/')}/{name}"
            for name, space in node.get_node_names_and_namespaces()
            if name != node.get_name()
        )
        commanders = sorted(
            f"{each.node_namespace.rstrip('/')}/{each.node_name}"
            for each in node.get_publishers_info_by_topic("joint_commands")
        )
        executor.shutdown()
        node.destroy_node()
        return Heard(tuple(nodes), sent, tuple(commanders), diagnostics)
    finally:
        rclpy.try_shutdown(context=context)


def look_at_network(heard: Heard) -> Iterator[Finding]:
    """Clocks, targets, commanders and diagnostics of what was heard."""
    yield _nodes(heard)
    yield _clocks(heard)
    yield _targets(heard)
    yield _commanders(heard)
    yield from _diagnostics(heard)


def _nodes(heard: Heard) -> Finding:
    twice = sorted({node for node in heard.nodes if heard.nodes.count(node) > 1})
    if any(node.endswith("/servo_bus") for node in twice):
        return Finding(
            "nodes",
            Level.RED,
            f"there is more than one {', '.join(twice)}: two heads answer to the same commands",
            "end one of them, or give it a ROS_DOMAIN_ID or a namespace of its own",
        )
    if twice:
        return Finding("nodes", Level.AMBER, f"there twice: {', '.join(twice)}", "end one of each")
    return Finding("nodes", Level.GREEN, f"{len(heard.nodes)} others are heard")


def _clocks(heard: Heard) -> Finding:
    """The quickest message of each topic tells how far the clocks can be apart at most."""
    check = "clock skew"
    skews = {
        topic: min(came - sent for sent, came, _ in messages) * 1e-9
        for topic, messages in heard.sent.items()
        if messages and all(sent > 0 for sent, _, _ in messages)
    }
    if not skews:
        return Finding(check, Level.SKIPPED, "nobody publishes anything here")
    topic = max(skews, key=lambda name: abs(skews[name]))
    skew = skews[topic]
    ahead = skew < -_AHEAD[0]
    text = (
        f"{topic} comes {-1e3 * skew:.1f} ms before it was sent: its publisher's clock is ahead"
        if ahead
        else f"{topic} comes {1e3 * skew:.1f} ms after it was sent, at the soonest"
    )
    level = Level.GREEN
    if skew > _SKEW[1] or skew < -_AHEAD[1]:
        level = Level.RED
    elif skew > _SKEW[0] or ahead:
        level = Level.AMBER
    cure = "" if level is Level.GREEN else (
        "keep the clocks of all machines together: chrony on each, one of them as the server "
        "(docs/distributed.md)"
    )  # fmt: skip
    return Finding(check, level, text, cure)


def _targets(heard: Heard) -> Finding:
    check = "stamps of targets"
    ages = [
        (came - stamp) * 1e-9
        for _, came, stamp in heard.sent.get("target_point", ())
        if stamp is not None
    ]
    if not ages:
        return Finding(check, Level.SKIPPED, "no target_point with a stamp came")
    age = median(ages)
    cure = "stamp each point with the time at which its image was taken, by the same clock"
    if abs(age) > _OTHER_CLOCK:
        text = "by another clock than the wall's: simulated time, or never set"
        return Finding(check, Level.AMBER, text, f"{cure}; use_sim_time must agree on all nodes")
    text = f"{1e3 * age:.0f} ms old when they come"
    if age < -_AHEAD[1] or age > _OLD[1]:
        return Finding(check, Level.RED, f"{text}; such points are not followed", cure)
    if age > _OLD[0]:
        return Finding(check, Level.AMBER, text, cure)
    return Finding(check, Level.GREEN, text)


def _commanders(heard: Heard) -> Finding:
    check = "joint_commands"
    strangers = [name for name in heard.commanders if name.endswith("/_NODE_NAME_UNKNOWN_")]
    text = f"from {', '.join(heard.commanders) or 'nobody'}"
    if strangers:
        return Finding(
            check,
            Level.RED,
            f"{text}; somebody commands who is no ROS node, or has just died",
            "find out who; docs/distributed.md says how to keep others out",
        )
    if len(heard.commanders) > 1:
        return Finding(check, Level.AMBER, text, "the joints follow one owner; end the others")
    return Finding(check, Level.GREEN, text)


def _diagnostics(heard: Heard) -> Iterator[Finding]:
    if not heard.diagnostics:
        return
    for name, (status, message) in sorted(heard.diagnostics.items()):
        level = {0: Level.GREEN, 2: Level.RED}.get(status, Level.AMBER)
        cure = "" if level is Level.GREEN else "docs/hardware.md, by symptom"
        yield Finding("diagnostics", level, f"{name}: {message}", cure)
