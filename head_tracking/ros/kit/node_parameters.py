"""The fields of a dataclass as ROS parameters, where their values come from, and wrong names."""

from __future__ import annotations

import dataclasses
import json
import math
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from head_tracking.exceptions import RefusedError
from head_tracking.parameter_files import COMMAND_LINE, Given, read, read_rule
from head_tracking.parameters import (
    ParameterError,
    ParameterInfo,
    allowed,
    checked,
    nearest,
    parameter_info,
    unknown,
    unknown_node,
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
    0.5. The file exists until the end of the block; the values are kept for `source`.

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
    with tempfile.NamedTemporaryFile("w", suffix=".yaml", encoding="utf-8") as file:
        json.dump(nodes, file, default=str)  # JSON is YAML
        file.flush()
        yield [*others, "--ros-args", "--params-file", file.name, "--"]


def source(node: Node, name: str) -> str:
    """Return the file that sets a parameter of a node, or `the command line`."""
    full_name = node.get_fully_qualified_name()
    files = [given.file for given in _given if given.name == name and given.is_for(full_name)]
    return files[-1] if files else COMMAND_LINE


def check_parameters(nodes: Iterable[Node], *, names: bool = True) -> None:
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
        own = [given for given in _given if given.is_for(full_name)]
        shared = {each.name for each in own if not each.node and each.file != COMMAND_LINE} - {
            each.name for each in own if each.node
        }
        declared, given = node._parameters, node._parameter_overrides
        for name in sorted(given):
            problem = "" if name in shared else unknown(name, declared, given)
            if problem:
                problems.append(f"{source(node, name)}: {full_name} {problem}")
    if names:
        # one file may configure nodes of several processes
        problems += _misspelt_nodes({*NODES, *(node.get_name() for node in nodes)})
    if problems:
        raise UnknownParametersError("; ".join(problems) + "; nothing was moved")


def _misspelt_nodes(known: set[str]) -> Iterator[str]:
    for file, name in dict.fromkeys((given.file, given.node) for given in _given):
        if file != COMMAND_LINE:
            problem = unknown_node(name, known)
        else:
            problem = "" if name in known else f"there is no node {name}{nearest(name, known)}"
        if name and problem:
            yield f"{file}: {problem}"


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
        self._fields = {field.name: field for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
        self._infos = {name: parameter_info(field) for name, field in self._fields.items()}
        for name, maximum in (maxima or {}).items():
            self._infos[name] = dataclasses.replace(self._infos[name], maximum=maximum)
        self._on_change = on_change
        self._is_possible = check
        values, refused = {}, []
        for name, field in self._fields.items():
            default, info = (defaults or {}).get(name, field.default), self._infos[name]
            try:
                given = node._parameter_overrides.get(prefix + name)
                if given is not None:  # this error is plainer than rclpy's
                    checked(prefix + name, info, field.default, given.value)
                value = node.declare_parameter(
                    prefix + name,
                    list(default) if isinstance(default, tuple) else default,
                    _descriptor(info, default),
                ).value
                values[name] = checked(prefix + name, info, field.default, value)
            except (ParameterException, ParameterError) as error:
                refused.append((name, error))
        if refused:
            raise ParameterError("; ".join(self._description(*each) for each in refused))
        self.value: P = kind(**values)
        if hasattr(node, "add_post_set_parameters_callback"):
            node.add_on_set_parameters_callback(self._check)
            node.add_post_set_parameters_callback(self._set)
        else:  # ROS 2 Humble
            node.add_on_set_parameters_callback(self._check_and_set)

    def _description(self, name: str, error: Exception) -> str:
        """Return the error of a field's value, and where the value comes from."""
        full_name = self._prefix + name
        where = f"{source(self._node, full_name)}: {self._node.get_fully_qualified_name()}"
        return f"{where}: {error}"

    def _checked(self, values: dict[str, Any]) -> dict[str, Any]:
        return {
            name: checked(
                self._prefix + name,
                self._infos[name],
                self._fields[name].default,
                value,
            )
            for name, value in values.items()
        }

    def _changed(self, parameters: Sequence[Parameter]) -> P | None:
        """Return the dataclass with new parameters; None if none of them is a field."""
        own = {
            name: parameter.value
            for parameter in parameters
            if parameter.name.startswith(self._prefix)
            and (name := parameter.name.removeprefix(self._prefix)) in self._fields
        }
        if not own:
            return None
        return dataclasses.replace(self.value, **self._checked(own))  # type: ignore[type-var]

    def _check(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        try:
            changed = self._changed(parameters)
            if changed is not None and self._is_possible is not None:
                self._is_possible(changed)
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
        changed = self._changed(parameters)
        if changed is not None:
            self.value = changed
            if self._on_change is not None:
                self._on_change(changed)


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
