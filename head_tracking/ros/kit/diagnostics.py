"""Messages of /diagnostics, the topic of all robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from head_tracking.compatibility import StrEnum


class Level(IntEnum):
    """Levels of diagnostic_msgs."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


FAULT = "fault"
"""Key of the value with the names of the faults: `FaultName`, error bits, symptoms of the bus."""


class FaultName(StrEnum):
    """Faults in diagnostics, besides the servos' own error bits and what the diagnosis finds."""

    NO_PORT = "no port"
    NOT_FOUND = "not found"
    NO_ANSWER = "no answer"
    LATE = "late"
    HOT = "hot"
    SILENT = "silent"


@dataclass(frozen=True, slots=True)
class Part:
    """The status of one part of the robot."""

    name: str
    level: Level
    message: str
    values: Mapping[str, str]


def health_from_message(status: DiagnosticStatus) -> Part:
    """Return the status of a message. An unknown level becomes STALE."""
    level = Level(min(int.from_bytes(status.level, "little"), Level.STALE))
    values = {pair.key: pair.value for pair in status.values}
    return Part(status.name, level, status.message, values)


def status_message(
    name: str, level: Level, text: str, values: Mapping[str, str], hardware_id: str = ""
) -> DiagnosticStatus:
    """Return a status message."""
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
    """Return the message for /diagnostics with the status of one part of the robot.

    The node's name is put before that of the part.
    """
    name = f"{node.get_name()}: {name}"
    return diagnostics(node, [status_message(name, level, text, values, "head")])


def diagnostics(node: Node, statuses: Sequence[DiagnosticStatus]) -> DiagnosticArray:
    """Return a message for /diagnostics, with the node's namespace before the names in it.

    Example, as of diagnostic_updater with `use_fqn`: `left/servo_bus: head_pan_joint`.
    """
    namespace = node.get_namespace().strip("/")
    for status in statuses if namespace else ():
        status.name = f"{namespace}/{status.name}"
    message = DiagnosticArray(status=statuses)
    message.header.stamp = node.get_clock().now().to_msg()
    return message
