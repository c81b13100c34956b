"""What a person reads: banner, state, error as a plot, the bus, the servos."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence

import viser

from head_tracking.recording.recording import Observation
from head_tracking.viewer.advice import Trouble, troubles
from head_tracking.viewer.health_table import health_table
from head_tracking.viewer.notify import notify
from head_tracking.viewer.plots import ERROR, GAZE, Strip, wanted_gaze
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
