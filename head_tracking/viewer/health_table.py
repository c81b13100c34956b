"""Diagnostics as HTML: a table of the servos, and a line for each part."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence

from head_tracking.ros.diagnostics import Health, Level

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
"""Keys of a servo's diagnostics (ros/bus_status.py)."""

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
    if key == _POSITION and value != "-":
        return f"{math.degrees(float(value)):.1f}°"
    return html.escape(value)


def _dot(one: Health) -> str:
    return f'<b style="color:{_COLOURS[one.level]}">&#9679;</b>'


def _name(one: Health) -> str:
    return html.escape(one.name.removeprefix("servo_bus: "))
