"""Types of messages by name: their classes, and their definitions as text."""

from __future__ import annotations

import importlib
import importlib.util
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from head_tracking.exceptions import HeadTrackingError

_LINE = "=" * 80
_NESTED = re.compile(r"([a-zA-Z]\w*)/(\w+)")
_WORDS = {"boolean": "bool", "float": "float32", "double": "float64", "octet": "byte"}
"""Words of OMG's IDL that ROS's definitions have others for."""

_KNOWN = {"tf2_msgs/msg/TFMessage": {"transforms": "sequence<geometry_msgs/TransformStamped>"}}
"""The fields of types that are written and read also where their packages are not installed."""


class MessagesMissingError(HeadTrackingError, LookupError):
    """A package of messages is not installed; the message says which."""


def message_class(name: str) -> Any:
    """The class of a type such as `std_msgs/msg/Bool`.

    Raises:
        MessagesMissingError: the package that defines it is not installed.
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
    """The definition of a type and of all types in it, as MCAP's encoding `ros2msg` wants it.

    The text that the package has installed; where it has none, one made of the class's fields.
    Format: https://mcap.dev/spec/registry#ros2msg.

    Raises:
        LookupError: the package that defines it is not installed.
    """
    parts = [_text(name)]
    for package, kind in dict.fromkeys(_nested(name)):
        parts.append(f"{_LINE}\nMSG: {package}/{kind}\n{_text(f'{package}/msg/{kind}')}")
    return "\n".join(parts)


def _fields(name: str) -> Mapping[str, str]:
    try:
        fields: Mapping[str, str] = message_class(name).get_fields_and_field_types()
    except LookupError:
        if name not in _KNOWN:
            raise
        return _KNOWN[name]
    return fields


def _nested(name: str) -> list[tuple[str, str]]:
    """Package and name of the types in it, each before those in itself."""
    found = []
    for field in _fields(name).values():
        for package, kind in _NESTED.findall(field):
            found += [(package, kind), *_nested(f"{package}/msg/{kind}")]
    return found


def _text(name: str) -> str:
    package, _, kind = name.partition("/msg/")
    spec = importlib.util.find_spec(package)
    for folder in Path((spec and spec.origin) or "").parents:
        file = folder / "share" / package / "msg" / f"{kind}.msg"
        if file.is_file():
            return file.read_text()
    return _text_from_fields(name)


def _text_from_fields(name: str) -> str:
    """A definition without comments, defaults and constants."""
    return "".join(f"{_type(field)} {called}\n" for called, field in _fields(name).items())


def _type(field: str) -> str:
    """A field's type as a definition has it, from IDL: `sequence<double, 3>` is `float64[<=3]`."""
    if field.startswith("sequence<"):
        inner, _, bound = field[len("sequence<") : -1].partition(", ")
        return f"{_type(inner)}[{f'<={bound}' if bound else ''}]"
    if field.endswith("]"):
        inner, _, size = field[:-1].rpartition("[")
        return f"{_type(inner)}[{size}]"
    if match := re.fullmatch(r"(w?string)<(\d+)>", field):
        return f"{match[1]}<={match[2]}"
    return _WORDS.get(field, field)
