"""Parameters as fields of a frozen dataclass: value, meaning, unit and range in one place.

A node declares the fields as ROS parameters; the core sees only the dataclass.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from head_tracking.exceptions import HeadTrackingError

_KEY = "parameter"


class ParameterError(HeadTrackingError, ValueError):
    """A parameter's value is not allowed; the message says what is."""


@dataclass(frozen=True, slots=True)
class ParameterInfo:
    """What a person needs to know to set a parameter.

    Attributes:
        description: what it does.
        unit: its unit; empty for names and switches.
        minimum: smallest allowed number.
        maximum: largest allowed number.
        choices: the allowed words; empty for any.
        fixed: can be set at the start only.
    """

    description: str
    unit: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()
    fixed: bool = False


def parameter(
    default: Any,
    description: str,
    *,
    unit: str = "",
    minimum: float = -math.inf,
    maximum: float = math.inf,
    choices: tuple[str, ...] = (),
    fixed: bool = False,
) -> Any:
    """A field of a dataclass that is also a parameter; see :class:`ParameterInfo`."""
    info = ParameterInfo(description, unit, minimum, maximum, choices, fixed)
    return dataclasses.field(default=default, metadata={_KEY: info})


def parameter_info(field: dataclasses.Field[Any]) -> ParameterInfo:
    """What was said of a field made by :func:`parameter`."""
    info = field.metadata[_KEY]
    assert isinstance(info, ParameterInfo)
    return info


def checked(name: str, info: ParameterInfo, default: Any, value: Any) -> Any:
    """The value in the type of its default, if it is allowed.

    Args:
        name: the parameter's name, for the message.
        info: what is allowed.
        default: decides the type; an int is taken where a float is wanted.
        value: what somebody set; a sequence becomes a tuple.

    Raises:
        ParameterError: wrong type, out of range or not finite; says what is allowed.
    """
    if isinstance(default, tuple):
        if isinstance(value, str) or not hasattr(value, "__iter__"):
            raise ParameterError(f"{name} is {value!r}; it must be a list")
        element = default[0] if default else ""
        return tuple(checked(f"{name}[{i}]", info, element, v) for i, v in enumerate(value))
    wanted = type(default)
    if wanted is float and type(value) is int:
        value = float(value)
    if type(value) is not wanted:
        raise ParameterError(f"{name} is {value!r}; it must be a {wanted.__name__}")
    if wanted in (int, float) and not info.minimum <= value <= info.maximum:
        raise ParameterError(f"{name} is {value}; allowed is {allowed(info)}")
    if info.choices and value not in info.choices:
        raise ParameterError(f"{name} is {value!r}; allowed are {', '.join(info.choices)}")
    return value


def allowed(info: ParameterInfo) -> str:
    """The range of a number in words, with its unit."""
    unit = f" {info.unit}" if info.unit else ""
    if math.isinf(info.minimum) and math.isinf(info.maximum):
        return f"any number{unit}"
    if math.isinf(info.maximum):
        return f"{info.minimum:g}{unit} or more"
    if math.isinf(info.minimum):
        return f"{info.maximum:g}{unit} or less"
    return f"{info.minimum:g} to {info.maximum:g}{unit}"
