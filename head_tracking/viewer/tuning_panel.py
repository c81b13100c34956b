"""Every parameter that can be changed while its node runs, as an input of its kind."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import viser

from head_tracking.viewer.notify import by_person, notify
from head_tracking.viewer.observation import Outcome, Setting
from head_tracking.viewer.other_parameters import OtherParameters
from head_tracking.viewer.steering_panel import refusal

_HELD = 1.5  # s: an input that a person changes is left alone for so long
_STEPS = 200
_LARGEST_RATIO = 1e4
"""A slider over more decades than this could not be set with any care: a number field."""


class TuningPanel:
    """A folder for each node; inputs set the real parameters and show what was refused."""

    def __init__(self, server: viser.ViserServer, parameters: OtherParameters) -> None:
        self._gui = server.gui
        self._parameters = parameters
        self._refusal = self._gui.add_html("")
        self._box = self._gui.add_folder(None)
        self._folders: dict[str, Any] = {}
        self._inputs: dict[tuple[str, str], Any] = {}
        self._touched: dict[tuple[str, str], float] = {}

    def refresh(self) -> None:
        """Follows parameters that others change, and nodes that come and go."""
        settings = {(one.node, one.name): one for one in self._parameters.settings()}
        for key in self._inputs.keys() - settings.keys():
            self._inputs.pop(key).remove()
        nodes = {node for node, _ in settings}
        for node in self._folders.keys() - nodes:
            self._folders.pop(node).remove()
        for key, setting in settings.items():
            if key not in self._inputs:
                self._inputs[key] = self._make(setting)
            elif time.monotonic() - self._touched.get(key, -math.inf) > _HELD:
                self._inputs[key].value = shown_value(setting.value)

    def _make(self, setting: Setting) -> Any:
        folder = self._folders.get(setting.node)
        if folder is None:
            name = setting.node.removeprefix("/")
            with self._box:
                folder = self._folders[setting.node] = self._gui.add_folder(
                    name, expand_by_default=name in ("head_tracker", "point_head")
                )
        with folder:
            made = make_input(self._gui, setting)

        def on_update(event: viser.GuiEvent[Any]) -> None:
            if by_person(event):
                self._set(event, setting, made)

        made.on_update(on_update)
        return made

    def _set(self, event: viser.GuiEvent[Any], setting: Setting, made: Any) -> None:
        key = (setting.node, setting.name)
        self._touched[key] = time.monotonic()
        try:
            value = sent_value(setting, made.value)
        except ValueError as error:
            outcome = Outcome(False, f"{setting.name}: {error}")
        else:
            outcome = self._parameters.set(setting.node, setting.name, value)
        if outcome.done:
            self._refusal.content = ""
            return
        self._touched.pop(key, None)  # shows the value that stays, at the next refresh
        self._refusal.content = refusal(outcome.text)
        notify(event, outcome, setting.name)


def make_input(gui: Any, setting: Setting) -> Any:
    """An input that fits a parameter: what its node would refuse it can still send."""
    value, name, hint = setting.value, setting.name, setting.description
    if isinstance(value, bool):
        return gui.add_checkbox(name, value, hint=hint)
    if isinstance(value, int | float):
        return _number(gui, setting)
    if isinstance(value, str) and setting.choices:
        return gui.add_dropdown(name, setting.choices, initial_value=value, hint=hint)
    if isinstance(value, list) and len(value) == 3:
        x, y, z = value
        return gui.add_vector3(name, (x, y, z), step=0.01, hint=hint)
    return gui.add_text(name, shown_value(value), hint=hint)


def shown_value(value: Any) -> Any:
    """A parameter's value as its input shows it."""
    if isinstance(value, list):
        return tuple(value) if len(value) == 3 else ", ".join(f"{number:g}" for number in value)
    return value


def sent_value(setting: Setting, shown: Any) -> Any:
    """What an input shows, as its parameter's type.

    Raises:
        ValueError: it is no list of numbers.
    """
    if not isinstance(setting.value, list):
        return type(setting.value)(shown)
    if isinstance(shown, str):
        try:
            return [float(word) for word in shown.replace(",", " ").split()]
        except ValueError:
            raise ValueError(f"{shown!r} is no list of numbers") from None
    return [float(number) for number in shown]


def _number(gui: Any, setting: Setting) -> Any:
    value, low, high = setting.value, setting.minimum, setting.maximum
    label, hint = setting.name, setting.description
    whole = isinstance(value, int)
    if math.isfinite(low) and math.isfinite(high):
        step: float = 1 if whole else slider_step(low, high)
        if whole or (high - low) / max(abs(value), step) < _LARGEST_RATIO:
            kind: Callable[[float], float] = int if whole else float
            return gui.add_slider(label, kind(low), kind(high), step, value, hint=hint)
    return gui.add_number(label, value, step=1 if whole else 0.01, hint=hint)


def slider_step(low: float, high: float) -> float:
    """A round step [same unit] of which about 200 to 1000 make up the range."""
    return float(10.0 ** math.floor(math.log10((high - low) / _STEPS)))
