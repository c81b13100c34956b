"""Parameters of other nodes in degrees, and presets."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from head_tracking.exceptions import HeadTrackingError
from head_tracking.page.head_modes import CONTROLLERS, POINTER, SENDERS, TRACKER
from head_tracking.ros.kit.others import OtherParameters, Setting
from head_tracking.tracking import LAWS, LearningParameters

_ROUNDED = 0.005  # largest relative error: a slider sends three digits

_DEGREES = {"rad": "°", "rad/s": "°/s", "rad/s^2": "°/s²", "rad/s^3": "°/s³"}
_FOR_EVERYBODY = {
    *("law", "max_joint_speed", "target_timeout", "recenter_timeout", "enable_target_search"),
    *("search_target_timeout", "default_joint_speed"),
}
"""Parameters of `head_tracker` outside the section for experts, beside those of its law."""

_LEARNING = {field.name for field in dataclasses.fields(LearningParameters)}
"""Parameters of `head_tracker` that freeze, forget or replace learned values: on the tab Health."""

PRESETS: Mapping[str, Mapping[str, float]] = {
    "calm": {
        "max_joint_speed": 45.0, "max_joint_acceleration": 400.0,
        "default_joint_speed": 10.0, "max_velocity": 30.0,
    },
    "normal": {},
    "fast": {
        "max_joint_speed": 500.0, "max_joint_acceleration": 6000.0,
        "default_joint_speed": 60.0, "max_velocity": 200.0,
    },
}  # fmt: skip
"""Values in degrees. Other parameters keep the values that the page found first."""


class Tuning:
    """Lists and sets the parameters of other nodes; for any thread.

    A value that a node refuses raises HeadTrackingError.
    """

    def __init__(self, parameters: OtherParameters) -> None:
        self._parameters = parameters
        self._found: dict[tuple[str, str], Any] = {}

    def listed(self) -> list[dict[str, Any]]:
        """Return the parameters that have an effect, for JSON; see `described`."""
        everything = sorted(self._settings(), key=lambda one: _base(one.node) not in CONTROLLERS)
        laws = {one.node: one.value for one in everything if one.name == "law"}
        return [described(one) for one in everything if not _of_another_law(one, laws)]

    def set(self, node: str, name: str, shown: Any) -> str:
        """Set a parameter to a value in the page's unit; return the answer of its node.

        Raises:
            ValueError: there is no such parameter, or the value does not fit it.
        """
        for one in self._settings():
            if (one.node, one.name) == (node, name):
                return self._parameters.set(node, name, sent_value(one, shown))
        raise ValueError(f"{node} has no parameter {name!r} that can be changed.")

    def reset(self) -> str:
        """Restore the values that the page found first."""
        return self._set_all([(one, self._found[one.node, one.name]) for one in self._settings()])

    def choose(self, preset: str) -> str:
        """Set the parameters of a preset.

        Raises:
            ValueError: there is no such preset.
        """
        if preset not in PRESETS:
            raise ValueError(f"There is no preset {preset!r}: choose {', '.join(PRESETS)}.")
        return self._set_all(self._of_preset(preset))

    def presets(self) -> dict[str, dict[str, Any]]:
        """Return the values of each preset by parameter, for JSON; see `shown_value`."""
        return {
            preset: {
                one.name: shown_value(dataclasses.replace(one, value=value))
                for one, value in self._of_preset(preset)
            }
            for preset in PRESETS
        }

    def chosen(self) -> str:
        """Return the preset whose values are set; empty: none."""
        for preset in PRESETS:
            wanted = self._of_preset(preset)
            if wanted and all(math.isclose(one.value, value) for one, value in wanted):
                return preset
        return ""

    def _of_preset(self, preset: str) -> list[tuple[Setting, float]]:
        """Return the parameters of the presets with their values in one of them."""
        degrees, found = PRESETS[preset], []
        for one in self._settings():
            if _base(one.node) in CONTROLLERS and one.name in PRESETS["calm"]:
                value = self._found[one.node, one.name]
                if degrees:
                    value = min(max(math.radians(degrees[one.name]), one.minimum), one.maximum)
                found.append((one, value))
        return found

    def _settings(self) -> tuple[Setting, ...]:
        settings = self._parameters.settings()
        for one in settings:
            self._found.setdefault((one.node, one.name), one.value)
        return settings

    def _set_all(self, wanted: Sequence[tuple[Setting, Any]]) -> str:
        wanted, refused = [(one, value) for one, value in wanted if one.value != value], []
        for one, value in wanted:
            try:
                self._parameters.set(one.node, one.name, value)
            except HeadTrackingError as refusal:
                refused.append(str(refusal))
        if refused:
            raise HeadTrackingError("; ".join(refused))
        return f"{len(wanted)} parameters set."


def described(setting: Setting) -> dict[str, Any]:
    """Return a parameter for JSON: its value, range and label in the page's unit."""
    factor = _factor(setting)
    low, high = factor * setting.minimum, factor * setting.maximum
    return {
        "node": setting.node,
        "name": setting.name,
        "label": label(setting),
        "unit": _unit(setting),
        "hint": setting.description,
        "value": shown_value(setting),
        "whole": isinstance(setting.value, int) and not isinstance(setting.value, bool),
        "low": low if math.isfinite(low) else None,
        "high": high if math.isfinite(high) else None,
        "choices": list(setting.choices),
        "expert": _is_expert(setting),
        "learning": _base(setting.node) == TRACKER and setting.name in _LEARNING,
        "careful": _base(setting.node) == "servo_bus",  # it protects the servos: the page asks
    }


def label(setting: Setting) -> str:
    """Return a parameter's name in words."""
    *groups, name = setting.name.split(".")
    group = " ".join(groups).replace("_controller", "").replace("_", " ")
    return (f"{group}: {name}" if group else name).replace("_", " ")


def shown_value(setting: Setting) -> Any:
    """Return the value of a parameter for the page: angles in degrees, lists and nan as text."""
    value = setting.value
    if isinstance(value, list):
        return ", ".join(f"{number:g}" for number in value)
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)  # JSON has no such number
    factor = _factor(setting)
    return value if factor == 1.0 else float(f"{value * factor:.4g}")


def sent_value(setting: Setting, shown: Any) -> Any:
    """Return a value from the page in the type and unit of its parameter.

    A number that is beyond the range only because it was rounded becomes the end of the range.

    Raises:
        ValueError: it does not fit the type or the range.
    """
    if isinstance(setting.value, list):
        return [finite(word) for word in str(shown).replace(",", " ").split()]
    if isinstance(setting.value, bool):
        if not isinstance(shown, bool):
            raise ValueError(f"{setting.name} must be true or false, not {shown!r}.")
        return shown
    if isinstance(setting.value, str):
        return str(shown)
    number, is_whole = finite(shown), isinstance(setting.value, int)
    if is_whole and number != round(number):
        raise ValueError(f"{setting.name} must be a whole number, not {shown!r}.")
    sent = number / _factor(setting)
    nearest = min(max(sent, setting.minimum), setting.maximum)
    if not math.isclose(sent, nearest, rel_tol=0.0 if is_whole else _ROUNDED):
        low, high = (_factor(setting) * end for end in (setting.minimum, setting.maximum))
        allowed = f"{low:g} to {high:g} {_unit(setting)}".strip()
        raise ValueError(f"{label(setting)} is {number:g}; allowed are {allowed}.")
    return int(nearest) if is_whole else nearest


def finite(shown: Any) -> float:
    """Return a number of a request; raise ValueError if it is none, or not finite."""
    try:
        number = float(shown)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{shown!r} is not a number.") from None
    if not math.isfinite(number):
        raise ValueError(f"{shown!r} is not a finite number.")
    return number


def _factor(setting: Setting) -> float:
    """Return the page's unit; what replaces a learned value has the unit of that."""
    angle = isinstance(setting.value, float) and setting.unit in _DEGREES
    return math.degrees(1.0) if angle and setting.name not in _LEARNING else 1.0


def _unit(setting: Setting) -> str:
    unit = setting.unit if _factor(setting) == 1.0 else _DEGREES[setting.unit]
    return unit.replace("^2", "²")


def _base(node: str) -> str:
    return node.rpartition("/")[2]


def _is_expert(setting: Setting) -> bool:
    node, name = _base(setting.node), setting.name
    if node == TRACKER:
        return name not in _FOR_EVERYBODY.union(*map(_names_of, LAWS))
    return node not in (POINTER, *SENDERS)


def _of_another_law(setting: Setting, laws: Mapping[str, Any]) -> bool:
    """Return whether a parameter belongs only to laws that are not active."""
    active = laws.get(setting.node)
    users = [law for law in LAWS if setting.name in _names_of(law)]
    return active is not None and bool(users) and active not in users


def _names_of(law: str) -> set[str]:
    return {field.name for field in dataclasses.fields(LAWS[law].Parameters)}
