"""The files and arguments that parameters come from, and mistakes in their names."""

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

if TYPE_CHECKING:
    from rclpy.node import Node

_LIKELY = 0.75  # similarity of names for a suggestion
_LISTED = 3


class UnknownParametersError(RefusedError):
    """Parameters or nodes do not exist."""


_given: list[Given] = []
_COMMAND_LINE: Final = "the command line"
_RULE: Final = re.compile(r"(\w+):([\w.]+):=(.*)", re.DOTALL)  # node, parameter, value


def remember(arguments: Sequence[str]) -> None:
    """Record which parameters the arguments of ROS and their files set."""
    _given.clear()
    for word, file in pairwise(arguments):
        if word == "--params-file":
            with suppress(OSError, ValueError, yaml.YAMLError):  # ROS has reported the error
                _given.extend(read(file))
    for node, values in _rules(arguments)[0].items():
        _given.extend(Given(_COMMAND_LINE, f"/**/{node}", name) for name in values)


@contextmanager
def rules_in_namespace(arguments: Sequence[str]) -> Iterator[list[str]]:
    """Yield arguments of ROS in which `-p node:name:=value` works in a namespace.

    ROS ignores such a rule for nodes outside of the root namespace. So the rules are written to a
    parameter file, which exists until the end of the block.
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
    """Return the file that sets a parameter of a node, or `the command line`."""
    full_name = node.get_fully_qualified_name()
    files = [given.file for given in _given if given.name == name and given.is_for(full_name)]
    return files[-1] if files else _COMMAND_LINE


def check(nodes: Iterable[Node], *, names: bool = True) -> None:
    """Find values for parameters and nodes that do not exist, after all were declared.

    On the command line each name must exist. In a file these are ignored: values for nodes of any
    name (`/**`), and values for a node whose name is similar to none of ours, or contains one.

    Args:
        nodes: those of this process.
        names: check names of nodes, too; False: another process does that.

    Raises:
        UnknownParametersError: lists them with similar names that exist.
    """
    nodes = list(nodes)
    problems = []
    for node in nodes:
        full_name = node.get_fully_qualified_name()
        shared = {given.name for given in _given if not given.node and given.is_for(full_name)} - {
            given.name for given in _given if given.node and given.is_for(full_name)
        }
        declared, given = node._parameters, node._parameter_overrides
        for name in sorted(given):
            is_known = (
                name in declared
                or name in shared
                or name.startswith("qos_overrides.")
                or f"{name.split('.', 1)[0]}.motor.id" in given  # a servo that is not in use
            )
            if not is_known:
                problems.append(
                    f"{source(node, name)}: {full_name} has no parameter {name}"
                    f"{_nearest(name, declared)}"
                )
    if names:
        # one file may configure nodes of several processes
        problems += _misspelt_nodes({*NODES, *(node.get_name() for node in nodes)})
    if problems:
        raise UnknownParametersError("; ".join(problems) + "; nothing was moved")


def _misspelt_nodes(known: set[str]) -> Iterator[str]:
    for file, name in dict.fromkeys((given.file, given.node) for given in _given):
        if file == _COMMAND_LINE:
            is_wrong = name not in known
        else:  # servo_bus_left may be a second servo_bus
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
