"""Parameters as fields of a frozen dataclass, with description, unit and range.

A node declares the fields as ROS parameters; the core uses the dataclass only.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any, TypeVar

from head_tracking.exceptions import HeadTrackingError

P = TypeVar("P")

_KEY = "parameter"
_LIKELY, _LISTED = 0.75, 3  # similarity and number of suggested names
_WORD = r"([A-Za-z_]|\{(node|ns|namespace)\})\w*"
_ROS_NAME = re.compile(rf"(~/|/)?{_WORD}(/{_WORD})*|~", re.ASCII)
_KINDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


class ParameterError(HeadTrackingError, ValueError):
    """A value of a parameter is not allowed; the message has the allowed values."""


@dataclass(frozen=True, slots=True)
class ParameterInfo:
    """Description and allowed values of a parameter.

    Attributes:
        description: its effect.
        unit: empty for names and switches.
        minimum: smallest allowed number.
        maximum: largest allowed number.
        choices: the allowed strings; empty: any.
        fixed: whether it can be set at the start only.
        ros_name: whether a text is the name of a topic or a part of one.
    """

    description: str
    unit: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()
    fixed: bool = False
    ros_name: bool = False


def parameter(default: Any, description: str, **info: Any) -> Any:
    """Make a field of a dataclass that is also a parameter; for `info` see `ParameterInfo`."""
    return dataclasses.field(default=default, metadata={_KEY: ParameterInfo(description, **info)})


def parameter_info(field: dataclasses.Field[Any]) -> ParameterInfo:
    """Return the information of a field made by `parameter`."""
    info = field.metadata[_KEY]
    assert isinstance(info, ParameterInfo)
    return info


def checked(name: str, info: ParameterInfo, default: Any, value: Any) -> Any:
    """Return an allowed value in the type of its default.

    Args:
        name: name of the parameter, for the error.
        info: the allowed values.
        default: decides the type; any real number is accepted for a float.
        value: the value to check; a sequence becomes a tuple.

    Raises:
        ParameterError: wrong type, out of range, not finite, or a name twice in a list of names.
    """
    if isinstance(default, tuple):
        if isinstance(value, str) or not hasattr(value, "__iter__"):
            raise ParameterError(f"{name} is {value!r}; it must be a list")
        element = default[0] if default else ""
        values = tuple(checked(f"{name}[{i}]", info, element, v) for i, v in enumerate(value))
        if info.ros_name and len(set(values)) < len(values):
            raise ParameterError(f"{name} is {list(values)}; each name is allowed once")
        return values
    expected = type(default)
    if expected is float and isinstance(value, Real) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not expected:
        raise ParameterError(f"{name} is {value!r}; it must be {_KINDS[expected]}")
    if expected in (int, float) and not info.minimum <= value <= info.maximum:
        raise ParameterError(f"{name} is {value}; allowed is {allowed(info)}")
    if info.choices and value not in info.choices:
        raise ParameterError(f"{name} is {value!r}; allowed are {', '.join(info.choices)}")
    if info.ros_name and value != default and not _ROS_NAME.fullmatch(value):
        raise ParameterError(
            f"{name} is {value!r}; a name in ROS has letters, digits, _ and /, such as left/servos"
        )
    return value


def changed(
    values: P,
    given: Mapping[str, Any],
    prefix: str = "",
    infos: Mapping[str, ParameterInfo] | None = None,
    where: Callable[[str], str] = lambda _: "",
) -> P:
    """Return parameters with new values; the same object if none of its fields is among them.

    Args:
        values: a frozen dataclass whose fields `parameter` has made.
        given: the new values, by name.
        prefix: put before the names of the fields in `given`.
        infos: the allowed values of each field; None: those of the class.
        where: returns what an error begins with, by the name of the value.

    Raises:
        ParameterError: values are not allowed; the message has all of them.
    """
    accepted, refused = {}, []
    for field in dataclasses.fields(values):  # type: ignore[arg-type]
        name = prefix + field.name
        if name in given:
            info = parameter_info(field) if infos is None else infos[field.name]
            try:
                accepted[field.name] = checked(name, info, field.default, given[name])
            except ParameterError as error:
                refused.append(f"{where(name)}{error}")
    if refused:
        raise ParameterError("; ".join(refused))
    return dataclasses.replace(values, **accepted) if accepted else values  # type: ignore[type-var]


def verified(values: P) -> P:
    """Return parameters whose values are allowed; a constructor does not check them.

    Raises:
        ParameterError: values are not allowed; the message has all of them.
    """
    given = {field.name: getattr(values, field.name) for field in dataclasses.fields(values)}  # type: ignore[arg-type]
    return changed(type(values)(), given)


def check_kind(given: object, kind: type) -> None:
    """Raise TypeError if an argument is neither None nor an object of a class."""
    if not isinstance(given, kind | None):
        raise TypeError(f"{given!r} is no {kind.__name__}")


def allowed(info: ParameterInfo) -> str:
    """Return the range of a number as text, with its unit."""
    unit = f" {info.unit}" if info.unit else ""
    low, high = (
        f"{end:.0f}" if float(end).is_integer() else f"{end:g}"  # not 4.5e+06
        for end in (info.minimum, info.maximum)
    )
    if math.isinf(info.minimum) and math.isinf(info.maximum):
        return f"any number{unit}"
    if math.isinf(info.maximum):
        return f"{low}{unit} or more"
    if math.isinf(info.minimum):
        return f"{high}{unit} or less"
    return f"{low} to {high}{unit}"


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a text with the known names that are similar to a wrong one; empty: there are none."""
    known = list(known)
    found = difflib.get_close_matches(name, known, _LISTED, _LIKELY) or [
        one for one in known if one.rsplit(".", 1)[-1] == name.rsplit(".", 1)[-1]
    ]
    return f" (is {' or '.join(found[:_LISTED])} meant?)" if found else ""
