"""Declares the fields of a dataclass as ROS parameters, and keeps its value up to date."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from head_tracking.parameters import (
    ParameterError,
    ParameterInfo,
    allowed,
    checked,
    parameter_info,
)
from head_tracking.ros.kit.parameter_sources import source

P = TypeVar("P")

_LARGEST = 1.7976931348623157e308


class NodeParameters(Generic[P]):
    """The ROS parameters of a node that make up one dataclass.

    A value that is not allowed is refused with the reason and the old one stays.

    Args:
        node: declares the parameters.
        kind: a frozen dataclass; :func:`head_tracking.parameters.parameter` makes its fields.
        prefix: put before the fields' names, such as ``head_pan_controller.``.
        defaults: values to use instead of the dataclass's own defaults.
        check: called with a value that somebody wants to set; raises ValueError to refuse it.
        on_change: called with the new value after somebody set a parameter.
        maxima: highest values allowed, where they depend on other parameters.

    Raises:
        ParameterError: values given at the start are not allowed; names each, and says what is.
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
                value = node.declare_parameter(
                    prefix + name,
                    list(default) if isinstance(default, tuple) else default,
                    _descriptor(info, default),
                ).value
                values[name] = checked(prefix + name, info, field.default, value)
            except (ParameterException, ParameterError) as error:
                refused.append((name, error))
        if refused:
            raise ParameterError("; ".join(self._told(*each) for each in refused))
        self.value: P = kind(**values)
        if hasattr(node, "add_post_set_parameters_callback"):
            node.add_on_set_parameters_callback(self._check)
            node.add_post_set_parameters_callback(self._take)
        else:  # ROS 2 Humble
            node.add_on_set_parameters_callback(self._check_and_take)

    def _told(self, name: str, error: Exception) -> str:
        """What is wrong with the value given for a field, and where it comes from."""
        full_name = self._prefix + name
        where = f"{source(self._node, full_name)}: {self._node.get_fully_qualified_name()}"
        if isinstance(error, InvalidParameterTypeException):
            given = self._node._parameter_overrides[full_name].value
            wanted = type(self._fields[name].default).__name__
            return f"{where}: {full_name} is {given!r}; it must be a {wanted}"
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
        """The dataclass with those of `parameters` that belong to it; None if none does."""
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
                # rclpy has described the refused value's type already
                described = self._node.describe_parameter(parameter.name)
                described.type = self._node.get_parameter(parameter.name).type_.value
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _check_and_take(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        result = self._check(parameters)
        if result.successful:
            self._take(parameters)
        return result

    def _take(self, parameters: Sequence[Parameter]) -> None:
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
        # lets `rate: 10` stand for 10.0; types and ranges are checked by head_tracking.parameters
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
