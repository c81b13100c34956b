"""What a person reads: banner, state, error as a plot, the bus, the servos."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence

import viser

from head_tracking.viewer.advice import Trouble, troubles
from head_tracking.viewer.health_table import health_table
from head_tracking.viewer.notify import notify
from head_tracking.viewer.observation import Observation
from head_tracking.viewer.plots import ErrorPlot
from head_tracking.viewer.robot import Robot


class StatusPanel:
    """The top of the control panel, and the tab with details."""

    def __init__(self, server: viser.ViserServer, robot: Robot) -> None:
        self._server = server
        self._robot = robot
        self._banner = server.gui.add_html("", visible=False)
        self._line = server.gui.add_html("")

    def add_details(self) -> None:
        """Adds the details to the container that is open now."""
        gui = self._server.gui
        self._plot = ErrorPlot(gui)
        self._bus = gui.add_html("")
        self._messages = gui.add_html("")
        recover = gui.add_button("Clear faults", hint="Calls the bus's service `recover`.")
        recover.on_click(self._on_recover)
        self._recover = recover
        recover.visible = False

    def refresh(self, live: Observation, notices: Sequence[str]) -> None:
        """Shows the newest state."""
        health = self._robot.health()
        found = troubles(health, live)
        self._banner.visible = bool(found)
        self._banner.content = _banner(found)
        self._line.content = _line(live)
        self._plot.add(live.stamp * 1e-9, live.error)
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


def _line(live: Observation) -> str:
    error = "-" if live.error is None else f"{math.degrees(live.error):.2f}°"
    target = live.target_text or "none"
    state = live.state or "nothing heard of the node that turns the head"
    return (
        '<div style="padding:0 0.8em 1em;font-size:0.85em">'  # viser's tabs begin a little higher
        f'<div id="state">{html.escape(state)}</div>'
        f'<div>error <b id="error">{error}</b>, target {html.escape(target)}</div></div>'
    )


def _list(title: str, lines: Sequence[str]) -> str:
    if not lines:
        return ""
    items = "".join(f"<div>{html.escape(line)}</div>" for line in lines)
    return f'<div style="padding:0.3em 0.8em;font-size:0.8em"><b>{title}</b>{items}</div>'
