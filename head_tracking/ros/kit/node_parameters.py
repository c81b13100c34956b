"""The fields of a dataclass as ROS parameters, where their values come from, and wrong names."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from head_tracking.exceptions import RefusedError
from head_tracking.parameter_files import (
    COMMAND_LINE,
    Given,
    read,
    read_rule,
    unknown_nodes,
    unknown_parameters,
)
from head_tracking.parameters import (
    ParameterInfo,
    allowed,
    changed,
    nearest,
    parameter_info,
)
from head_tracking.programs import NODES

P = TypeVar("P")

_ALL = "/**"  # all nodes
_LARGEST = 1.7976931348623157e308


class UnknownParametersError(RefusedError):
    """Parameters or nodes do not exist."""


_given: list[Given] = []


@contextmanager
def merged(arguments: Sequence[str]) -> Iterator[list[str]]:
    """Yield arguments of ROS with one parameter file, in which later values replace earlier ones.

    It has the values of all parameter files and of `-p`. ROS ignores `-p node:name:=value` for
    nodes in a namespace, and keeps the earlier one of two values of different types, such as 2 and
    0.5. The file needs no disk, which may be full; it exists until the end of the block. The values
    are kept for `source`.

    Raises:
        ParameterFileError: a file or a value is malformed.
    """
    _given.clear()
    others: list[str] = []
    for word in arguments:
        option = others[-1] if others else ""
        if option == "--params-file":
            others.pop()
            _given.extend(read(word))
        elif option in ("-p", "--param") and (rules := read_rule(word)):
            others.pop()
            _given.extend(rules)
        else:
            others.append(word)
    if not _given:
        yield others
        return
    nodes: dict[str, dict[str, dict[str, Any]]] = {}
    for nodes_of in dict.fromkeys([_ALL, *(given.nodes for given in _given)]):
        # with those for all nodes, because ROS prefers a value for fewer nodes to a later one
        values = {given.name: given.value for given in _given if given.nodes in (nodes_of, _ALL)}
        nodes[nodes_of] = {"ros__parameters": values}
    with open(os.memfd_create("parameters"), "w", encoding="utf-8") as file:
        json.dump(nodes, file, default=str)  # JSON is YAML
        file.flush()
        yield [*others, "--ros-args", "--params-file", f"/proc/self/fd/{file.fileno()}", "--"]


def source(node: Node, name: str) -> str:
    """Return the file that sets a parameter of a node, or `the command line`."""
    full_name = node.get_fully_qualified_name()
    files = [given.file for given in _given if given.name == name and given.is_for(full_name)]
    return files[-1] if files else COMMAND_LINE


def check_parameters(nodes: Iterable[Node], *, names: bool = True) -> None:
    """Find values for parameters and nodes that do not exist, after all were declared.

    Args:
        nodes: those of this process.
        names: check names of nodes and what is given to all nodes, too; False: another process
            does that, which has more of them.

    Raises:
        UnknownParametersError: lists them with similar names that exist.
    """
    nodes = list(nodes)
    lacking: dict[tuple[str, ...], tuple[Given, list[str]]] = {}
    for node in nodes:
        name = node.get_fully_qualified_name()
        own = [one for one in _given if one.is_for(name) and (names or one.nodes != _ALL)]
        for given in unknown_parameters(own, node._parameters):
            lacking.setdefault(given[:3], (given, []))[1].append(name)
    problems = []
    for given, without in lacking.values():
        owners = [node.get_name() for node in nodes if given.name in node._parameters]
        known = {name for node in nodes for name in node._parameters}
        advice = nearest(given.name, known)
        if owners and given.nodes == _ALL:
            advice = f"; name the node: -p {owners[0]}:{given.name}:={given.value}"
        problems.append(f"{given.file}: no parameter {given.name} in {', '.join(without)}{advice}")
    if names:
        problems += unknown_nodes(_given, {*NODES, *(node.get_name() for node in nodes)})
    if problems:
        raise UnknownParametersError("; ".join(problems) + "; nothing was moved")


class NodeParameters(Generic[P]):
    """Declares the fields of a dataclass as parameters of a node, and keeps its value up to date.

    A value that is not allowed is refused with the reason.

    Args:
        node: declares the parameters.
        kind: a frozen dataclass; :func:`head_tracking.parameters.parameter` makes its fields.
        prefix: put before the names of the fields, such as ``head_pan_controller.``.
        defaults: instead of those of the dataclass.
        check: called with a new value before it is set; raises a ValueError to refuse it.
        on_change: called with the new value after a parameter was set.
        maxima: largest allowed values that depend on other parameters.

    Raises:
        ParameterError: initial values are not allowed.
    """

    def __init__(
        self,
        node: Node,
        kind: type[P],
        prefix: str = "",
        defaults: dict[str, Any] | None = None,
        on_change: Callable[[P], None] | None = None,
        check: Callable[[P], object] | None = None,
        maxima: Mapping[str, float] | None = None,
    ) -> None:
        self._node = node
        self._prefix = prefix
        self._infos = {
            field.name: parameter_info(field)
            for field in dataclasses.fields(kind)  # type: ignore[arg-type]
        }
        for name, maximum in (maxima or {}).items():
            self._infos[name] = dataclasses.replace(self._infos[name], maximum=maximum)
        self._on_change = on_change
        self._is_possible = check
        usual = kind(**defaults or {})
        given = node._parameter_overrides
        for name in self._infos:
            empty = given.get(prefix + name)
            if (
                empty is not None
                and empty.value is None
                and isinstance(getattr(usual, name), tuple)
            ):
                given[prefix + name] = Parameter(prefix + name, value=[])  # rcl: [] is no value
        self.value = self._changed(usual, given.values(), self._where)
        for name, info in self._infos.items():
            value = getattr(usual, name)
            default = list(value) if isinstance(value, tuple) else value
            node.declare_parameter(prefix + name, default, _descriptor(info, value))
        if hasattr(node, "add_post_set_parameters_callback"):
            node.add_on_set_parameters_callback(self._check)
            node.add_post_set_parameters_callback(self._set)
        else:  # ROS 2 Humble
            node.add_on_set_parameters_callback(self._check_and_set)

    def _where(self, name: str) -> str:
        """Return where the value of a parameter comes from."""
        return f"{source(self._node, name)}: {self._node.get_fully_qualified_name()}: "

    def _changed(
        self, value: P, parameters: Iterable[Parameter], where: Callable[[str], str] = lambda _: ""
    ) -> P:
        """Return the dataclass with new values; the same one if no parameter is a field."""
        given = {parameter.name: parameter.value for parameter in parameters}
        return changed(value, given, self._prefix, self._infos, where)

    def _check(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        try:
            value = self._changed(self.value, parameters)
            if value is not self.value and self._is_possible is not None:
                self._is_possible(value)
        except ValueError as error:
            for parameter in parameters:
                # rclpy has already changed the type in the description
                described = self._node.describe_parameter(parameter.name)
                described.type = self._node.get_parameter(parameter.name).type_.value
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _check_and_set(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        result = self._check(parameters)
        if result.successful:
            self._set(parameters)
        return result

    def _set(self, parameters: Sequence[Parameter]) -> None:
        before, self.value = self.value, self._changed(self.value, parameters)
        if self.value is not before and self._on_change is not None:
            self._on_change(self.value)


def _descriptor(info: ParameterInfo, default: Any) -> ParameterDescriptor:
    unit = f" [{info.unit}]" if info.unit else ""
    descriptor = ParameterDescriptor(
        description=info.description + unit,
        read_only=info.fixed,
        # accept `rate: 10` for 10.0; head_tracking.parameters checks types and ranges
        dynamic_typing=isinstance(default, float | tuple),
    )
    if isinstance(default, bool | str | tuple):
        if info.choices:
            descriptor.additional_constraints = f"one of: {', '.join(info.choices)}"
        return descriptor
    descriptor.additional_constraints = allowed(info)
    if math.isinf(info.minimum) and math.isinf(info.maximum):
        return descriptor
    if isinstance(default, float):
        descriptor.floating_point_range = [
            FloatingPointRange(
                from_value=max(info.minimum, -_LARGEST), to_value=min(info.maximum, _LARGEST)
            )
        ]
    else:
        descriptor.integer_range = [
            IntegerRange(from_value=int(info.minimum), to_value=int(info.maximum), step=1)
        ]
    return descriptor
