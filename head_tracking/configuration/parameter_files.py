"""Reads ROS parameter files without ROS."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml

_PARAMETERS = "ros__parameters"


class Given(NamedTuple):
    """One value of a parameter file.

    Attributes:
        file: name of the file.
        nodes: name or pattern of the nodes, such as `/**/servo_bus`.
        name: of the parameter.
        value: from YAML.
    """

    file: str
    nodes: str
    name: str
    value: Any = None

    def is_for(self, node: str) -> bool:
        """Return whether the pattern matches the full name of a node, by the rules of rcl."""
        pattern = re.escape(self.nodes if self.nodes.startswith("/") else f"/{self.nodes}")
        pattern = pattern.replace(r"/\*\*", r"(/\w+)*").replace(r"/\*", r"/\w+")
        return re.fullmatch(pattern, node) is not None

    @property
    def node(self) -> str:
        """The last part of the pattern; empty for a wildcard."""
        last = self.nodes.rsplit("/", 1)[-1]
        return "" if "*" in last else last


def read(file: str) -> list[Given]:
    """Return all values of a file.

    Raises:
        OSError: the file cannot be read.
        ValueError: it has no parameters of nodes.
        yaml.YAMLError: it is not YAML.
    """
    with open(file, encoding="utf-8") as text:
        content = yaml.safe_load(text)
    if not isinstance(content or {}, Mapping):
        raise ValueError(f"{file}: expected nodes with ros__parameters, not {content!r}")
    return list(_values(file, "", content))


def parameters_of(node: str, files: Iterable[Path]) -> dict[str, Any]:
    """Return the parameters of a node in any namespace; later files win."""
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
