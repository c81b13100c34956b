"""Joints by hand: sliders with limits, centre, randomise, and a torque switch per servo."""

from __future__ import annotations

import math
import random
import time
from collections.abc import Mapping
from typing import Any

import viser

from head_tracking.recording.recording import Observation
from head_tracking.ros.kit.other_services import Outcome
from head_tracking.transforms import Joint, JointType, RobotModel
from head_tracking.viewer.joint_control import JointControl, Servo
from head_tracking.viewer.notify import by_person, notify, small

_HELD = 1.5
"""A slider that a person moved stays put for so long [s], then follows the joint again."""

_FOLLOWED = 0.2  # degrees or mm: smaller motion of a joint is not worth a message
_STEP = 0.1  # degrees or mm


class JointsPanel:
    """Sliders for joints that somebody can move; those of others only show where they are."""

    def __init__(self, server: viser.ViserServer, control: JointControl) -> None:
        gui = server.gui
        self._gui = gui
        self._control = control
        self._hint = gui.add_html("")
        centre = gui.add_button("Centre all joints", icon=viser.Icon.FOCUS_CENTERED)
        randomise = gui.add_button("Randomise", icon=viser.Icon.ARROWS_SHUFFLE)
        on = gui.add_button("Torque on, all", hint="Holds where the servos stand; nothing moves.")
        on.on_click(lambda event: notify(event, control.set_torque("", True), "Torque"))
        centre.on_click(lambda event: self._set_all(event, _middle))
        randomise.on_click(lambda event: self._set_all(event, _anywhere))
        self._switches_box = gui.add_folder("Torque", visible=False)
        self._sliders_box = gui.add_folder("Positions (degrees or mm)")
        self._sliders: dict[str, Any] = {}
        self._switches: dict[str, Any] = {}
        self._touched: dict[str, float] = {}
        self._joints: dict[str, Joint] = {}

    def set_model(self, model: RobotModel) -> None:
        """Makes sliders for the joints of a model."""
        for slider in self._sliders.values():
            slider.remove()
        self._joints = {name: model.joints[name] for name in model.independent_joints}
        with self._sliders_box:
            self._sliders = {name: self._slider(joint) for name, joint in self._joints.items()}

    def refresh(self, live: Observation) -> None:
        """Lets sliders and switches follow the robot."""
        now = time.monotonic()
        servos = self._control.servos()
        movable = self._movable(servos)
        for name, slider in self._sliders.items():
            slider.disabled = name not in movable
            position = live.joints.get(name)
            if position is None or now - self._touched.get(name, -math.inf) < _HELD:
                continue
            position = min(max(position / _unit(self._joints[name]), slider.min), slider.max)
            if abs(position - slider.value) > _FOLLOWED:
                slider.value = round(position, 1)
        self._show_hint(servos, movable)
        self._refresh_switches(servos, now)

    def _movable(self, servos: tuple[Servo, ...]) -> set[str]:
        if self._control.free:
            return set(self._joints)
        return {servo.joint for servo in servos if not servo.refuses} & set(self._joints)

    def _show_hint(self, servos: tuple[Servo, ...], movable: set[str]) -> None:
        if self._control.free:
            text = "No hardware: the sliders say where the joints are (joint_states)."
        elif not servos:
            text = "No servo bus is known yet: the sliders only show the joints."
        else:
            loose = ", ".join(servo.joint for servo in servos if servo.torque is False)
            text = f"Relaxed: {loose}. The sliders follow the hand." if loose else ""
            if len(movable) < len(servos):
                text += " Switch torque on to move joints from here."
        self._hint.content = small(text)

    def _refresh_switches(self, servos: tuple[Servo, ...], now: float) -> None:
        self._switches_box.visible = bool(servos)
        there = {servo.controller for servo in servos}
        for controller in self._switches.keys() - there:
            self._switches.pop(controller).remove()
        for servo in servos:
            switch = self._switches.get(servo.controller)
            if switch is None:
                with self._switches_box:
                    switch = self._switch(servo)
                self._switches[servo.controller] = switch
            if servo.torque is not None and now - self._touched.get(servo.controller, 0) > _HELD:
                switch.value = servo.torque

    def _switch(self, servo: Servo) -> Any:
        switch = self._gui.add_checkbox(
            servo.controller.removesuffix("_controller"),
            bool(servo.torque),
            hint="On: holds where it stands, or turns. Off: can be moved by hand.",
        )

        def on_update(event: viser.GuiEvent[Any]) -> None:
            if by_person(event):
                self._touched[servo.controller] = time.monotonic()
                notify(event, self._control.set_torque(servo.controller, switch.value), "Torque")

        switch.on_update(on_update)
        return switch

    def _slider(self, joint: Joint) -> Any:
        unit, (lower, upper) = _unit(joint), _range(joint)
        slider = self._gui.add_slider(
            joint.name,
            round(math.ceil(lower / unit / _STEP) * _STEP, 1),
            round(math.floor(upper / unit / _STEP) * _STEP, 1),
            _STEP,
            round(_middle(joint) / unit, 1),
        )

        def on_update(event: viser.GuiEvent[Any]) -> None:
            if by_person(event):
                notify(event, self._move({joint.name: slider.value * unit}), joint.name)

        slider.on_update(on_update)
        return slider

    def _move(self, positions: Mapping[str, float]) -> Outcome:
        self._touched.update(dict.fromkeys(positions, time.monotonic()))
        return self._control.move(positions)

    def _set_all(self, event: viser.GuiEvent[Any], where: Any) -> None:
        movable = self._movable(self._control.servos())
        if not movable:
            text = "no joint can be moved from here; is torque switched on?"
            notify(event, Outcome(False, text), "Joints")
            return
        positions = {name: where(self._joints[name]) for name in sorted(movable)}
        outcome = self._move(positions)
        for name, position in positions.items():
            self._sliders[name].value = round(position / _unit(self._joints[name]), 1)
        notify(event, outcome, "Joints")


def _unit(joint: Joint) -> float:
    """What a person reads, in radians or metres: degrees, or millimetres."""
    return 1e-3 if joint.type is JointType.PRISMATIC else math.radians(1.0)


def _range(joint: Joint) -> tuple[float, float]:
    lower, upper = max(joint.limits.lower, -math.pi), min(joint.limits.upper, math.pi)
    return round(math.ceil(lower * 1e3) / 1e3, 3), round(math.floor(upper * 1e3) / 1e3, 3)


def _anywhere(joint: Joint) -> float:
    return round(random.uniform(*_range(joint)), 3)


def _middle(joint: Joint) -> float:
    lower, upper = _range(joint)
    return 0.0 if lower <= 0.0 <= upper else round(0.5 * (lower + upper), 3)
