"""Parameter files: who gave a value, and what in them no node knows."""

from __future__ import annotations

import difflib
import re
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import yaml

from head_tracking.configuration.parameter_files import Given, read
from head_tracking.exceptions import RefusedError
from head_tracking.programs import NODES
from head_tracking.ros.kit.head_lock import namespace

if TYPE_CHECKING:  # the tools that read these files work without ROS
    from rclpy.node import Node

_LIKELY = 0.75  # how alike a name must be to be meant
_LISTED = 3


class UnknownParametersError(RefusedError):
    """A file names parameters or nodes that do not exist."""


_given: list[Given] = []
_COMMAND_LINE: Final = "the command line"
_RULE: Final = re.compile(
    r"(\w+):([\w.]+):=(.*)", re.DOTALL
)  # a node's name, a parameter, its value


def remember(arguments: Sequence[str]) -> None:
    """Reads the files that ROS's arguments name, which ROS has taken already."""
    _given.clear()
    for word, file in pairwise(arguments):
        if word == "--params-file":
            with suppress(OSError, ValueError, yaml.YAMLError):  # ROS has reported it
                _given.extend(read(file))
    for node, values in _rules(arguments)[0].items():
        _given.extend(Given(_COMMAND_LINE, f"/**/{node}", name) for name in values)


@contextmanager
def rules_in_namespace(arguments: Sequence[str]) -> Iterator[list[str]]:
    """Yield ROS's arguments; in a namespace with each `-p node:name:=value` in a file.

    ROS uses such a rule for nodes of the root namespace only, and ignores it for others. The file
    is there until the end of the block.
    """
    rules, others = _rules(arguments)
    prefix = namespace(arguments).rstrip("/")
    if not (rules and prefix):
        yield list(arguments)
        return
    with tempfile.NamedTemporaryFile("w", suffix=".yaml", encoding="utf-8") as file:
        for node, values in rules.items():
            file.write(f"{prefix}/{node}:\n  ros__parameters:\n")
            file.writelines(f"    {name}: {value}\n" for name, value in values.items())
        file.flush()
        yield [*others, "--ros-args", "--params-file", file.name, "--"]


def _rules(arguments: Sequence[str]) -> tuple[dict[str, dict[str, str]], list[str]]:
    """Return the values of `-p node:name:=value` by node and name, and the other arguments."""
    rules: dict[str, dict[str, str]] = {}
    others: list[str] = []
    for word in arguments:
        rule = _RULE.fullmatch(word)
        if rule and others and others[-1] in ("-p", "--param"):
            others.pop()
            node, name, value = rule.groups()
            rules.setdefault(node, {})[name] = value
        else:
            others.append(word)
    return rules, others


def source(node: Node, name: str) -> str:
    """Where a node's value comes from: a file, or the command line."""
    full_name = node.get_fully_qualified_name()
    files = [given.file for given in _given if given.name == name and given.is_for(full_name)]
    return files[-1] if files else _COMMAND_LINE


def check(nodes: Iterable[Node], *, names: bool = True) -> None:
    """Looks for values that nobody takes, after the nodes have declared their parameters.

    On the command line, one for a node that does not exist is nobody's. In a file, a value for
    nodes of any name (`/**`) is somebody's if it is not one of these nodes'. So is one for a node
    whose name is like none of ours, or is one of ours with something more.

    Args:
        nodes: those of this process.
        names: whether names of nodes are checked, too; False: another process does that.

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
    if names:
        # one file can be for several nodes, each in a process of its own
        problems += _misspelt_nodes({*NODES, *(node.get_name() for node in nodes)})
    if problems:
        raise UnknownParametersError("; ".join(problems) + "; nothing was moved")


def _misspelt_nodes(known: set[str]) -> Iterator[str]:
    for file, name in dict.fromkeys((given.file, given.node) for given in _given):
        if file == _COMMAND_LINE:
            is_wrong = name not in known
        else:  # servo_bus_left is somebody's second servo_bus
            is_wrong = not any(one in name for one in known) and bool(_alike(name, known))
        if name and is_wrong:
            yield f"{file}: there is no node {name}{_nearest(name, known)}"


def _alike(name: str, known: Iterable[str]) -> list[str]:
    return difflib.get_close_matches(name, list(known), _LISTED, _LIKELY)


def _nearest(name: str, known: Iterable[str]) -> str:
    known = list(known)
    found = _alike(name, known) or [
        one for one in known if one.rsplit(".", 1)[-1] == name.rsplit(".", 1)[-1]
    ]
    return f" (is {' or '.join(found[:_LISTED])} meant?)" if found else ""
