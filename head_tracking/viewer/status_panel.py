"""What a person reads: banner, state, error as a plot, the bus, the servos."""

from __future__ import annotations

import html
import math
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import viser

from head_tracking.gaze import PanTiltHead
from head_tracking.recording.recording import Observation
from head_tracking.ros.kit.diagnostics import Health, Level
from head_tracking.transforms import RobotModel
from head_tracking.viewer.advice import Trouble, troubles
from head_tracking.viewer.notify import notify
from head_tracking.viewer.robot import Robot

_REPLAY = "a recording"


class StatusPanel:
    """The top of the control panel, and the tab with details."""

    def __init__(self, server: viser.ViserServer, robot: Robot) -> None:
        self._server = server
        self._robot = robot
        self._banner = server.gui.add_html("", visible=False)
        self._line = server.gui.add_html("")
        self._strips: list[Strip] = []

    def add_strip(self) -> None:
        """Adds the head against its target to the container that is open now."""
        title = "Head, and what would look at the target (°)"
        self._strips.append(Strip(self._server.gui, title, GAZE))

    def add_details(self) -> None:
        """Adds the details to the container that is open now."""
        gui = self._server.gui
        self._error = Strip(gui, "Error (degrees) over the last seconds", ERROR)
        self._bus = gui.add_html("")
        self._messages = gui.add_html("")
        recover = gui.add_button("Clear faults", hint="Calls the bus's service `recover`.")
        recover.on_click(self._on_recover)
        self._recover = recover
        recover.visible = False

    def take(self, live: Observation) -> None:
        """Takes what is seen now into the plots."""
        now, head = live.stamp * 1e-9, self._robot.head()
        self._error.add(now, [live.error])
        if head is not None:
            pan, tilt = wanted_gaze(self._robot.model(), head, live)
            joints = live.joints.get
            angles = [joints(head.pan_joint), pan, joints(head.tilt_joint), tilt]
            for strip in self._strips:
                strip.add(now, angles)

    def refresh(
        self, live: Observation, notices: Sequence[str], replayed: Observation | None = None
    ) -> None:
        """Shows the newest state, with the numbers of a recording that is shown instead."""
        health = self._robot.health()
        found = troubles(health, live)
        self._banner.visible = bool(found)
        self._banner.content = _banner(found)
        head = self._robot.head()
        joints = () if head is None else (head.pan_joint, head.tilt_joint)
        mode = _REPLAY if replayed else str(self._robot.modes.mode())
        self._line.content = _line(replayed or live, mode, joints)
        self._error.draw()
        for strip in self._strips:
            strip.draw()
        self._bus.content = health_table(health)
        self._messages.content = _list("Notices", notices) + _list(
            "Warnings of nodes", self._robot.topics.warnings()[-6:]
        )
        self._recover.visible = self._robot.joints.can_recover

    def _on_recover(self, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
        notify(event, self._robot.joints.recover(), "Clear faults")


def _banner(found: Sequence[Trouble]) -> str:
    items = "".join(
        f"<div><b>{html.escape(one.what)}</b><br/>{html.escape(one.advice)}</div>" for one in found
    )
    return (
        '<div id="banner" style="background:#c92a2a;color:white;margin:0.4em 0.8em;'
        f'padding:0.5em 0.8em;border-radius:4px;font-size:0.9em">{items}</div>'
    )


def _line(live: Observation, mode: str, joints: Sequence[str]) -> str:
    angles = {"pan": None, "tilt": None, "error": live.error}
    angles |= {name: live.joints.get(joint) for name, joint in zip(angles, joints, strict=False)}
    numbers = " &nbsp; ".join(
        f'{name} <b id="{name}">{_degrees(angle)}</b>' for name, angle in angles.items()
    )
    target = f" {html.escape(live.target_text)}" if live.target_text else ""
    verb = "shown:" if mode == _REPLAY else "looks at"
    state = live.state or "no node is switched on to turn the head"
    return (
        '<div style="padding:0 0.8em 1em;font-size:0.85em">'  # viser's tabs begin a little higher
        f'<div>{verb} <b id="mode">{html.escape(mode)}</b>{target}</div>'
        f'<div style="font-size:1.1em">{numbers}</div>'
        f'<div id="state" style="opacity:0.8">{html.escape(state)}</div></div>'
    )


def _degrees(angle: float | None) -> str:
    return "-" if angle is None else f"{math.degrees(angle):.1f}°"


def _list(title: str, lines: Sequence[str]) -> str:
    if not lines:
        return ""
    items = "".join(f"<div>{html.escape(line)}</div>" for line in lines)
    return f'<div style="padding:0.3em 0.8em;font-size:0.8em"><b>{title}</b>{items}</div>'


_SECONDS = 30.0
_LEAST = 0.09  # s between samples
_PAN, _TILT = "#1971c2", "#2f9e44"

GAZE: Sequence[Mapping[str, Any]] = (
    {"label": "pan", "stroke": _PAN, "width": 2},
    {"label": "pan wanted", "stroke": _PAN, "width": 1, "dash": (4, 4)},
    {"label": "tilt", "stroke": _TILT, "width": 2},
    {"label": "tilt wanted", "stroke": _TILT, "width": 1, "dash": (4, 4)},
)
ERROR: Sequence[Mapping[str, Any]] = (
    {"label": "error (degrees)", "stroke": "#c2255c", "width": 2},
)


class Strip:
    """Some angles in degrees over the last half minute.

    Args:
        gui: viser's control panel, with the container open that gets the plot.
        title: what it shows.
        series: label and looks of each angle.
    """

    def __init__(self, gui: Any, title: str, series: Sequence[Mapping[str, Any]]) -> None:
        self._samples: deque[tuple[float, ...]] = deque()
        nothing = np.array([np.nan, np.nan])
        self._plot = gui.add_uplot(
            data=(np.array([-_SECONDS, 0.0]), *(nothing for _ in series)),
            series=({"label": "seconds"}, *series),
            # a fixed axis: the client loses one that has to follow negative times
            scales={"x": {"time": False, "range": (-_SECONDS, 0.0)}, "y": {"auto": True}},
            title=title,
            aspect=1.9,
        )

    def add(self, now: float, angles: Sequence[float | None]) -> None:
        """Takes angles [rad] at a time [s]; None: there is none."""
        samples = self._samples
        if samples and now < samples[-1][0]:
            samples.clear()  # the clock was set back
        if samples and now - samples[-1][0] < _LEAST:
            return
        samples.append((now, *(math.nan if one is None else math.degrees(one) for one in angles)))
        while now - samples[0][0] > _SECONDS:
            samples.popleft()

    def draw(self) -> None:
        """Shows what it has."""
        if len(self._samples) > 1:
            now = self._samples[-1][0]
            # arrays of their own: viser sends the memory as it lies there
            times, *angles = (np.array(column) for column in zip(*self._samples, strict=True))
            self._plot.data = (times - now, *angles)


def wanted_gaze(
    model: RobotModel | None, head: PanTiltHead | None, live: Observation
) -> tuple[float | None, float | None]:
    """Pan and tilt [rad] that look at the target, or come nearest to it; None without one."""
    if model is None or head is None or live.target is None:
        return None, None
    standing = dict.fromkeys(model.independent_joints, 0.0)
    target = model.transform(model.root, head.base_frame, standing).inverse() @ live.target
    positions = (live.joints.get(joint, 0.0) for joint in (head.pan_joint, head.tilt_joint))
    gaze = head.gaze(target, *positions)
    return gaze.pan, gaze.tilt


_POSITION = "position (rad)"

ROWS = {
    "torque": "torque",
    "°C": "temperature (degrees Celsius)",
    "V": "voltage (V)",
    "load": "load (share of full torque)",
    "position": _POSITION,
    "errors": "errors",
    "timeouts": "timeouts",
    "corrupt": "corrupt replies",
    "model": "model",
}
"""Keys of a servo's diagnostics (ros/bus/bus_status.py)."""

_COLOURS = {
    Level.OK: "#2b8a3e",
    Level.WARN: "#e67700",
    Level.ERROR: "#c92a2a",
    Level.STALE: "#868e96",
}


def health_table(health: Sequence[Health]) -> str:
    """Diagnostics as HTML; what is wrong comes first."""
    servos = [one for one in health if ROWS["torque"] in one.values]
    lines = []
    for one in sorted(health, key=lambda one: -one.level):
        lines.append(f"<div>{_dot(one)} <b>{_name(one)}</b>: {html.escape(one.message)}</div>")
        if one not in servos:
            lines += [
                f'<div style="padding-left:1.2em;opacity:0.8">{html.escape(key)}: '
                f"{html.escape(value)}</div>"
                for key, value in one.values.items()
            ]
    if not health:
        lines.append("<div>nothing on /diagnostics</div>")
    content = (_table(servos) if servos else "") + "".join(lines)
    return f'<div style="padding:0 0.8em;font-size:0.85em">{content}</div>'


def _table(servos: Sequence[Health]) -> str:
    """A column for each servo: a head has two, and the panel is narrow."""
    head = "".join(f"<th>{_dot(one)} {_name(one)}</th>" for one in servos)
    rows = "".join(
        f"<tr><td>{title}</td>"
        + "".join(f"<td>{_cell(key, one.values.get(key, '-'))}</td>" for one in servos)
        + "</tr>"
        for title, key in ROWS.items()
    )
    return (
        '<div style="overflow-x:auto;white-space:nowrap"><table style="font-size:0.9em;'
        'border-spacing:8px 0;margin-bottom:0.5em;text-align:left">'
        f"<tr><th></th>{head}</tr>{rows}</table></div>"
    )


def _cell(key: str, value: str) -> str:
    if key == ROWS["torque"]:
        return "on" if value == "torque on" else "off"  # why it is off is in the line below
    if key == _POSITION:
        with suppress(ValueError):  # it may be anybody's
            return f"{math.degrees(float(value)):.1f}°"
    return html.escape(value)


def _dot(one: Health) -> str:
    return f'<b style="color:{_COLOURS[one.level]}">&#9679;</b>'


def _name(one: Health) -> str:
    return html.escape(one.name.removeprefix("servo_bus: "))
