"""What nodes say of themselves on /diagnostics, one topic for all robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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


def status_message(
    name: str, level: Level, text: str, values: Mapping[str, str], hardware_id: str = ""
) -> DiagnosticStatus:
    """Return the message that says how something is."""
    return DiagnosticStatus(
        name=name,
        level=bytes((level,)),
        message=text,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )


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
    name = f"{node.get_name()}: {name}"
    return diagnostics(node, [status_message(name, level, text, values, "head")])


def diagnostics(node: Node, statuses: Sequence[DiagnosticStatus]) -> DiagnosticArray:
    """Return a message for /diagnostics, with the node's namespace before the names in it.

    As diagnostic_updater has it with `use_fqn`: `left/servo_bus: head_pan_joint`.
    """
    namespace = node.get_namespace().strip("/")
    for status in statuses if namespace else ():
        status.name = f"{namespace}/{status.name}"
    message = DiagnosticArray(status=statuses)
    message.header.stamp = node.get_clock().now().to_msg()
    return message
