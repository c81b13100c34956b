"""What nodes say of themselves on /diagnostics, one topic for all robots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node


class Level(IntEnum):
    """How bad it is, as in diagnostic_msgs."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class Health:
    """What one part of the robot says of itself on /diagnostics."""

    name: str
    level: Level
    message: str
    values: Mapping[str, str]


def health_from_message(status: DiagnosticStatus) -> Health:
    """Return what a status says. A level that diagnostic_msgs does not have becomes STALE."""
    level = Level(min(int.from_bytes(status.level, "little"), Level.STALE))
    values = {pair.key: pair.value for pair in status.values}
    return Health(status.name, level, status.message, values)


def report(
    node: Node, name: str, level: Level, text: str, values: Mapping[str, str]
) -> DiagnosticArray:
    """Return the message by which a node says how a part of the robot is.

    Args:
        node: that says it.
        name: of the part; the node's own name comes before it.
        level: how bad it is.
        text: for a person.
        values: what is known, by name.
    """
    status = DiagnosticStatus(
        name=f"{node.get_name()}: {name}",
        level=bytes((level,)),
        message=text,
        hardware_id="head",
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
    message = DiagnosticArray(status=[status])
    message.header.stamp = node.get_clock().now().to_msg()
    return in_namespace(node, message)


def in_namespace(node: Node, message: DiagnosticArray) -> DiagnosticArray:
    """The message, with the node's namespace before the names in it.

    As diagnostic_updater has it with `use_fqn`: `left/servo_bus: head_pan_joint`.
    """
    namespace = node.get_namespace().strip("/")
    if namespace:
        for status in message.status:
            status.name = f"{namespace}/{status.name}"
    return message
