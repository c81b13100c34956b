"""Message types by name: their classes and definitions."""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from typing import Any

from head_tracking.exceptions import HeadTrackingError

_LINE = "=" * 80
_NESTED = re.compile(r"([a-zA-Z]\w*)/(\w+)")
_WORDS = {"boolean": "bool", "float": "float32", "double": "float64", "octet": "byte"}
"""Types of OMG IDL that have another name in .msg files."""


class MessagesMissingError(HeadTrackingError, LookupError):
    """A package of messages is not installed."""


def message_class(name: str) -> Any:
    """Return the class of a type such as `std_msgs/msg/Bool`.

    Raises:
        MessagesMissingError: its package is not installed.
    """
    package, _, kind = name.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), kind)
    except (ImportError, AttributeError, ValueError) as error:
        raise MessagesMissingError(
            f"{package} is not installed; it comes with a ROS 2 installation "
            f"(ros-jazzy-{package.replace('_', '-')})"
        ) from error


def message_definition(name: str) -> str:
    """Return the definition of a type and all types in it, in MCAP's encoding `ros2msg`.

    It is made from the fields of the classes, without comments, defaults and constants.
    Format: https://mcap.dev/spec/registry#ros2msg.

    Raises:
        MessagesMissingError: its package is not installed.
    """
    parts = [_definition(name)]
    for package, kind in dict.fromkeys(_nested(name)):
        parts.append(f"{_LINE}\nMSG: {package}/{kind}\n{_definition(f'{package}/msg/{kind}')}")
    return "\n".join(parts)


def _fields(name: str) -> Mapping[str, str]:
    fields: Mapping[str, str] = message_class(name).get_fields_and_field_types()
    return fields


def _nested(name: str) -> list[tuple[str, str]]:
    """Return package and name of the types in it, in depth-first order."""
    found = []
    for field in _fields(name).values():
        for package, kind in _NESTED.findall(field):
            found += [(package, kind), *_nested(f"{package}/msg/{kind}")]
    return found


def _definition(name: str) -> str:
    return "".join(f"{_type(field)} {called}\n" for called, field in _fields(name).items())


def _type(field: str) -> str:
    """Convert the type of a field from IDL: `sequence<double, 3>` is `float64[<=3]`."""
    if field.startswith("sequence<"):
        inner, _, bound = field[len("sequence<") : -1].partition(", ")
        return f"{_type(inner)}[{f'<={bound}' if bound else ''}]"
    if field.endswith("]"):
        inner, _, size = field[:-1].rpartition("[")
        return f"{_type(inner)}[{size}]"
    if match := re.fullmatch(r"(w?string)<(\d+)>", field):
        return f"{match[1]}<={match[2]}"
    return _WORDS.get(field, field)
