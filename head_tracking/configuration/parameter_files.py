"""Reads parameter files of ROS without ROS."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml

_PARAMETERS = "ros__parameters"


class Given(NamedTuple):
    """One value in a file.

    Attributes:
        file: which.
        nodes: the names it is for, wildcards and all: `/**/servo_bus`.
        name: of the parameter.
        value: as YAML has it.
    """

    file: str
    nodes: str
    name: str
    value: Any = None

    def is_for(self, node: str) -> bool:
        """Whether a node of this full name takes it, by rcl's rules."""
        pattern = re.escape(self.nodes if self.nodes.startswith("/") else f"/{self.nodes}")
        pattern = pattern.replace(r"/\*\*", r"(/\w+)*").replace(r"/\*", r"/\w+")
        return re.fullmatch(pattern, node) is not None

    @property
    def node(self) -> str:
        """The last part of the name; empty if that is a wildcard."""
        last = self.nodes.rsplit("/", 1)[-1]
        return "" if "*" in last else last


def read(file: str) -> list[Given]:
    """Return all values in a file.

    Raises:
        OSError, ValueError, yaml.YAMLError: It cannot be read, or is not YAML.
    """
    with open(file, encoding="utf-8") as text:
        content = yaml.safe_load(text)
    if not isinstance(content or {}, Mapping):
        raise ValueError(f"{file} has {content!r}, not nodes and their ros__parameters")
    return list(_values(file, "", content))


def parameters_of(node: str, files: Iterable[Path]) -> dict[str, Any]:
    """Return the parameters of a node in files, whatever its namespace; later files win."""
    return {
        given.name: given.value
        for file in files
        for given in read(str(file))
        if given.node in (node, "")
    }


def _values(file: str, nodes: str, content: Any) -> Iterator[Given]:
    if not isinstance(content, Mapping):
        return
    for key, value in content.items():
        if key == _PARAMETERS:
            for name, given in _flat("", value):
                yield Given(file, nodes, name, given)
        else:
            yield from _values(file, f"{nodes}/{str(key).strip('/')}", value)


def _flat(prefix: str, content: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(content, Mapping):
        for key, value in content.items():
            yield from _flat(f"{prefix}.{key}" if prefix else str(key), value)
    elif content is not None:
        yield prefix, content
