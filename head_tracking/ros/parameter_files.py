"""Parameter files: who gave a value, and what in them no node knows."""

from __future__ import annotations

import difflib
import pkgutil
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import yaml

from head_tracking.exceptions import RefusedError

if TYPE_CHECKING:  # the tools that read these files work without ROS
    from rclpy.node import Node

_PARAMETERS = "ros__parameters"
_LIKELY = 0.75  # how alike a name must be to be meant
_LISTED = 3

NODE_NAMES = tuple(
    module.name for module in pkgutil.iter_modules([str(Path(__file__).parents[1] / "nodes")])
)
"""Of all our nodes: one file can be for several of them, each in a process of its own."""


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


class UnknownParametersError(RefusedError):
    """A file names parameters or nodes that do not exist."""


_given: list[Given] = []


def remember(arguments: Sequence[str]) -> None:
    """Reads the files that ROS's arguments name, which ROS has taken already."""
    _given.clear()
    for word, file in pairwise(arguments):
        if word == "--params-file":
            with suppress(OSError, ValueError, yaml.YAMLError):  # ROS has reported it
                _given.extend(read(file))


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


def source(node: Node, name: str) -> str:
    """Where a node's value comes from: a file, or the command line."""
    full_name = node.get_fully_qualified_name()
    files = [given.file for given in _given if given.name == name and given.is_for(full_name)]
    return files[-1] if files else "the command line"


def check(nodes: Iterable[Node]) -> None:
    """Looks for values that nobody takes, after the nodes have declared their parameters.

    A value for nodes of any name (`/**`) is somebody's if it is not one of these nodes'. So is one
    for a node whose name is like none of ours, or is one of ours with something more.

    Args:
        nodes: those of this process.

    Raises:
        UnknownParametersError: there are some; names each, with the nearest that exists.
    """
    nodes = list(nodes)
    problems = []
    for node in nodes:
        full_name = node.get_fully_qualified_name()
        anybodys = {
            given.name for given in _given if not given.node and given.is_for(full_name)
        } - {given.name for given in _given if given.node and given.is_for(full_name)}
        declared, given = node._parameters, node._parameter_overrides
        for name in sorted(given):
            is_known = (
                name in declared
                or name in anybodys
                or name.startswith("qos_overrides.")
                or f"{name.split('.', 1)[0]}.motor.id" in given  # a servo that is not in use
            )
            if not is_known:
                problems.append(
                    f"{source(node, name)}: {full_name} has no parameter {name}"
                    f"{_nearest(name, declared)}"
                )
    names = {*NODE_NAMES, *(node.get_name() for node in nodes)}
    for file, misspelt in dict.fromkeys((given.file, given.node) for given in _given):
        if not misspelt or any(name in misspelt for name in names):
            continue  # servo_bus_left is somebody's second servo_bus
        if _alike(misspelt, names):
            problems.append(f"{file}: there is no node {misspelt}{_nearest(misspelt, names)}")
    if problems:
        raise UnknownParametersError("; ".join(problems) + "; nothing was moved")


def _alike(name: str, known: Iterable[str]) -> list[str]:
    return difflib.get_close_matches(name, list(known), _LISTED, _LIKELY)


def _nearest(name: str, known: Iterable[str]) -> str:
    known = list(known)
    found = _alike(name, known) or [
        one for one in known if one.rsplit(".", 1)[-1] == name.rsplit(".", 1)[-1]
    ]
    return f" (is {' or '.join(found[:_LISTED])} meant?)" if found else ""


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
