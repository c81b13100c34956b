"""What can be tuned while it runs, in a person's words and units; each as an input of its kind."""

from __future__ import annotations

import dataclasses
import math
import re
import time
from collections.abc import Callable
from typing import Any

import viser

from head_tracking.ros.kit.other_parameters import OtherParameters, Setting
from head_tracking.ros.kit.other_services import Outcome
from head_tracking.tracking import LAWS
from head_tracking.viewer.logarithmic_slider import LogarithmicSlider
from head_tracking.viewer.notify import by_person, notify, refusal

_HELD = 1.5  # s: an input that a person changes is left alone for so long
_STEPS = 200
_LARGEST_RATIO = 1e4
"""A slider over more decades than this could not be set with any care: a number field."""

_DECADES = 99.0
"""A range of this ratio is set on a logarithmic scale (two decades, rounded in degrees)."""

_DEGREES = {"rad": "°", "rad/s": "°/s", "rad/s^2": "°/s²", "rad/s^3": "°/s³"}
_OFFERED = {
    "head_tracker": {
        *("law", "max_joint_speed", "target_timeout", "recenter_timeout", "enable_target_search"),
        *("search_target_timeout", "default_joint_speed"),
    },
    "point_head": None,
    "fictitious_target": None,
    "visual_target": None,
    "frame_target": None,
    "target_mux": None,
}
"""What is not for experts only, by node; None: everything, as of a law all of its own."""

_CAREFUL = {"servo_bus"}
"""Nodes whose limits keep the servos whole."""


class TuningPanel:
    """A folder for each node; inputs set the real parameters and show what was refused.

    Of the laws of `head_tracker` only the parameters of the active one are shown. What experts
    need is folded away, and what can hurt a servo asks first.
    """

    def __init__(self, server: viser.ViserServer, parameters: OtherParameters) -> None:
        self._gui = server.gui
        self._parameters = parameters
        self._style = self._gui.add_html("")
        self._refusal = self._gui.add_html("")
        reset = self._gui.add_button(
            "Reset", icon=viser.Icon.RESTORE, hint="All values back to what this page found first."
        )
        reset.on_click(self._on_reset)
        self._box = self._gui.add_folder(None)
        self._experts = self._gui.add_folder("For experts", expand_by_default=False, visible=False)
        self._folders: dict[tuple[str, bool], Any] = {}
        self._inputs: dict[tuple[str, str], Any] = {}
        self._touched: dict[tuple[str, str], float] = {}
        self._found: dict[tuple[str, str], Any] = {}

    def refresh(self) -> None:
        """Follows parameters that others change, and nodes that come and go."""
        everything = self._parameters.settings()
        laws = {one.node: one.value for one in everything if one.name == "law"}
        settings = {
            (one.node, one.name): one for one in everything if not _of_another_law(one, laws)
        }
        for key in self._inputs.keys() - settings.keys():
            self._inputs.pop(key).remove()
        needed = {(one.node, _is_expert(one)) for one in settings.values()}
        for folder in self._folders.keys() - needed:
            self._folders.pop(folder).remove()
        self._experts.visible = any(expert for _, expert in needed)
        for key, setting in settings.items():
            self._found.setdefault(key, setting.value)
            if key not in self._inputs:
                self._inputs[key] = self._make(setting)
            elif time.monotonic() - self._touched.get(key, -math.inf) > _HELD:
                self._inputs[key].value = shown_value(setting)
        styles = (one.style for one in self._inputs.values() if isinstance(one, LogarithmicSlider))
        self._style.content = f"<style>{' '.join(styles)}</style>"

    def _make(self, setting: Setting) -> Any:
        expert = _is_expert(setting)
        folder = self._folders.get((setting.node, expert))
        if folder is None:
            name = _base(setting.node)
            with self._experts if expert else self._box:
                folder = self._folders[setting.node, expert] = self._gui.add_folder(
                    name, expand_by_default=name in ("head_tracker", "point_head") and not expert
                )
        with folder:
            made = make_input(self._gui, setting)

        def on_update(event: viser.GuiEvent[Any]) -> None:
            if not by_person(event):
                return
            if _base(setting.node) in _CAREFUL:
                self._ask(event, setting, made)
            else:
                self._set(event, setting, made.value)

        made.on_update(on_update)
        return made

    def _ask(self, event: viser.GuiEvent[Any], setting: Setting, made: Any) -> None:
        """Ask whether a person is sure; all browsers show the value that is set, meanwhile, too."""
        value, client = made.value, event.client
        made.value = shown = self._shown(setting)
        if client is None:
            return
        with client.gui.add_modal("Are you sure?") as question:
            client.gui.add_html(
                f'<div id="sure" style="padding:0.5em 0.8em">{label(setting)}: '
                f"{shown} becomes {value}. It keeps the servos whole.</div>"
            )
            yes = client.gui.add_button("Set it", color="red")
            no = client.gui.add_button("Leave it as it is")

        def on_answer(answer: viser.GuiEvent[Any]) -> None:
            question.close()
            if answer.target is yes:
                self._set(event, setting, value)

        yes.on_click(on_answer)
        no.on_click(on_answer)

    def _shown(self, setting: Setting) -> Any:
        """Return what the input of a parameter shows while nobody changes it."""
        key = setting.node, setting.name
        found = (one for one in self._parameters.settings() if (one.node, one.name) == key)
        return shown_value(next(found, setting))

    def _set(self, event: viser.GuiEvent[Any], setting: Setting, shown: Any) -> None:
        key = (setting.node, setting.name)
        self._touched[key] = time.monotonic()
        try:
            value = sent_value(setting, shown)
        except ValueError as error:
            outcome = Outcome(False, f"{setting.name}: {error}")
        else:
            outcome = self._parameters.set(setting.node, setting.name, value)
        if outcome.done:
            self._refusal.content = ""
            return
        self._touched.pop(key, None)  # shows the value that stays, at the next refresh
        self._refusal.content = refusal(outcome.text)
        notify(event, outcome, label(setting))

    def _on_reset(self, event: viser.GuiEvent[Any]) -> None:
        changed = [
            one
            for one in self._parameters.settings()
            if one.value != self._found.get((one.node, one.name), one.value)
        ]
        outcomes = [
            self._parameters.set(one.node, one.name, self._found[one.node, one.name])
            for one in changed
        ]
        refused = [one.text for one in outcomes if not one.done]
        done = f"{len(changed)} values are what they were" if changed else "nothing was changed"
        notify(event, Outcome(not refused, "; ".join(refused) or done), "Reset")


def make_input(gui: Any, setting: Setting) -> Any:
    """An input that fits a parameter: what its node would refuse it can still send."""
    value, name, hint = setting.value, label(setting), f"{setting.name}: {setting.description}"
    if isinstance(value, bool):
        return gui.add_checkbox(name, value, hint=hint)
    if isinstance(value, int | float):
        return _number(gui, setting, name, hint)
    if isinstance(value, str):
        return gui.add_dropdown(name, setting.choices, initial_value=value, hint=hint)
    if len(value) == 3:
        x, y, z = value
        return gui.add_vector3(name, (x, y, z), step=0.01, hint=hint)
    return gui.add_text(name, shown_value(setting), hint=hint)


def label(setting: Setting) -> str:
    """A parameter's name as a person says it, with its unit."""
    *groups, name = setting.name.split(".")
    group = " ".join(groups).replace("_controller", "").replace("_", " ")
    words = f"{group}: {name}" if group else name
    unit = _unit(setting)
    shown = _DEGREES.get(unit, unit)
    return words.replace("_", " ") + (f" ({shown})" if shown else "")


def shown_value(setting: Setting) -> Any:
    """A parameter's value as its input shows it: angles in degrees."""
    value = setting.value
    if isinstance(value, list):
        return tuple(value) if len(value) == 3 else ", ".join(f"{number:g}" for number in value)
    factor = _factor(setting)
    return value if factor == 1.0 else round(value * factor, 3)


def sent_value(setting: Setting, shown: Any) -> Any:
    """What an input shows, as its parameter's type and in its unit.

    Raises:
        ValueError: it is no list of numbers.
    """
    if not isinstance(setting.value, list):
        factor = _factor(setting)
        return type(setting.value)(shown if factor == 1.0 else shown / factor)
    if isinstance(shown, str):
        try:
            return [float(word) for word in shown.replace(",", " ").split()]
        except ValueError:
            raise ValueError(f"{shown!r} is no list of numbers") from None
    return [float(number) for number in shown]


def _number(gui: Any, setting: Setting, name: str, hint: str) -> Any:
    factor = _factor(setting)
    value, low, high = shown_value(setting), factor * setting.minimum, factor * setting.maximum
    if factor != 1.0 and 1.0 < high - low < math.inf:  # no farther than its node allows
        low, high = math.ceil(100.0 * low) / 100.0, math.floor(100.0 * high) / 100.0
    whole = isinstance(setting.value, int)
    if math.isfinite(low) and math.isfinite(high):
        value = min(max(value, low), high)
        if _spans_decades(setting, low, high):
            return LogarithmicSlider(gui, name, low, high, value, hint)
        step: float = 1 if whole else slider_step(low, high)
        if whole or (high - low) / max(abs(value), step) < _LARGEST_RATIO:
            kind: Callable[[float], float] = int if whole else float
            return gui.add_slider(name, kind(low), kind(high), step, value, hint=hint)
    return gui.add_number(name, value, step=1 if whole else 0.01, hint=hint)


def _spans_decades(setting: Setting, low: float, high: float) -> bool:
    """Whether a range is two decades or more, or begins at a 0 with a meaning of its own."""
    if low == 0.0:
        return re.search(r"\b0(:| for) ", setting.description) is not None
    return low > 0.0 and high / low >= _DECADES


def slider_step(low: float, high: float) -> float:
    """A round step [same unit] of which about 200 to 1000 make up the range."""
    return float(10.0 ** math.floor(math.log10((high - low) / _STEPS)))


def _unit(setting: Setting) -> str:
    """The unit that stands at the end of a description, in brackets."""
    text = setting.description
    return text[text.rindex("[") + 1 : -1] if text.endswith("]") else ""


def _factor(setting: Setting) -> float:
    angle = isinstance(setting.value, float) and _unit(setting) in _DEGREES
    return math.degrees(1.0) if angle else 1.0


def _base(node: str) -> str:
    return node.rpartition("/")[2]


def _is_expert(setting: Setting) -> bool:
    offered = _OFFERED.get(_base(setting.node), set())
    if offered is None or setting.name in offered:
        return False
    return not any(setting.name in _names_of(law) for law in LAWS)


def _of_another_law(setting: Setting, laws: dict[str, Any]) -> bool:
    """Whether a parameter belongs to laws only that do not steer the head now."""
    active = laws.get(setting.node)
    users = [law for law in LAWS if setting.name in _names_of(law)]
    return active is not None and bool(users) and active not in users


def _names_of(law: str) -> set[str]:
    return {field.name for field in dataclasses.fields(LAWS[law].Parameters)}
