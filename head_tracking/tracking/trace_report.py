"""A trace as a table and as a plot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from head_tracking.tracking.trace import Array, Trace

_WIDTH, _HEIGHT, _LEFT, _RIGHT, _TOP, _GAP = 900, 180, 70, 150, 40, 36
_TARGET, _HEAD, _GRID = "#d9480f", "#1864ab", "#dddddd"
_MOST_POINTS = 1500  # of a curve


def table(trace: Trace, ages: Sequence[float], target_rate: float) -> str:
    """Return the figures of a run as a table.

    Args:
        trace: of the run.
        ages: of the points when they arrived [s].
        target_rate: points a second.
    """
    wanted = trace.velocities(trace.wanted)
    done = trace.velocities(trace.positions)
    rows = [
        ("recorded", f"{trace.times[-1]:.1f} s, {len(trace)} samples"),
        ("target", f"{target_rate:.1f} points/s, {1e3 * float(np.mean(ages)):.0f} ms old"),
        ("error, rms", _angle(trace.rms)),
        ("error, median", _angle(float(np.median(trace.errors)))),
        ("error, max", _angle(trace.maximum)),
        ("within 1°", f"{100.0 * trace.within(math.radians(1.0)):.0f} % of the time"),
        ("within 3°", f"{100.0 * trace.within(math.radians(3.0)):.0f} % of the time"),
        ("head behind its target", _lag(trace)),
        *(
            (
                f"top speed of {name}",
                f"{_top(done[:, joint]):.2f} rad/s for a target at {_top(wanted[:, joint]):.2f}",
            )
            for joint, name in enumerate(("pan", "tilt"))
        ),
        ("mean jerk of pan", f"{trace.jerk():.0f} rad/s³"),
    ]
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)


def lag(trace: Trace) -> float | None:
    """Return by how much the head is behind its target [s]; None if the target hardly moves."""
    times, steps = trace.times, np.arange(-0.3, 0.8, 0.005)
    if len(times) < 10 or times[-1] < 2.0 or float(trace.wanted.std(axis=0).max()) < 0.02:
        return None
    joint = int(np.argmax(trace.wanted.std(axis=0)))
    wanted, done = trace.wanted[:, joint], trace.positions[:, joint]
    inner = (times > times[0] + 0.8) & (times < times[-1] - 0.3)
    errors = [
        float(np.mean((np.interp(times[inner] - step, times, wanted) - done[inner]) ** 2))
        for step in steps
    ]
    return float(steps[int(np.argmin(errors))])


def picture(trace: Trace, title: str) -> str:
    """Return positions, error and speeds over time as SVG."""
    times, degrees = trace.times, 180.0 / math.pi
    wanted, done = trace.wanted * degrees, trace.positions * degrees
    wanted_speeds = trace.velocities(trace.wanted)
    speeds = trace.velocities(trace.positions)
    panels = [
        (f"{joint}, {unit}", [("target", target[:, k], _TARGET), ("head", head[:, k], _HEAD)])
        for unit, target, head in (("°", wanted, done), ("rad/s", wanted_speeds, speeds))
        for k, joint in enumerate(("pan", "tilt"))
    ]
    panels.insert(2, ("error, °", [("error", trace.errors * degrees, _HEAD)]))
    height = _TOP + len(panels) * (_HEIGHT + _GAP) + 10
    width = _LEFT + _WIDTH + _RIGHT
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="13">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
        f'<text x="{_LEFT}" y="24" font-size="16">{escape(title)}</text>',
    ]
    for index, (name, curves) in enumerate(panels):
        parts += _panel(_TOP + index * (_HEIGHT + _GAP), name, times, curves)
    return "\n".join((*parts, "</svg>\n"))


def _panel(
    top: float, name: str, times: Array, curves: Sequence[tuple[str, Array, str]]
) -> list[str]:
    lowest = min(float(values.min()) for _, values, _ in curves)
    highest = max(float(values.max()) for _, values, _ in curves)
    ticks = _ticks(lowest, highest)
    lowest, highest = min(lowest, ticks[0]), max(highest, ticks[-1])
    start, end = float(times[0]), float(times[-1])

    def x(time: float) -> float:
        return _LEFT + _WIDTH * (time - start) / max(end - start, 1e-9)

    def y(value: float) -> float:
        return top + _HEIGHT * (highest - value) / max(highest - lowest, 1e-9)

    bottom = top + _HEIGHT
    parts = [f'<text x="8" y="{top - 8:.0f}">{escape(name)}</text>']
    for value in ticks:
        parts.append(_line(_LEFT, y(value), _LEFT + _WIDTH, y(value)))
        parts.append(
            f'<text x="{_LEFT - 8}" y="{y(value) + 4:.1f}" text-anchor="end">{value:g}</text>'
        )
    for time in _ticks(start, end):
        parts.append(_line(x(time), top, x(time), bottom))
        parts.append(
            f'<text x="{x(time):.1f}" y="{bottom + 15}" text-anchor="middle">{time:g} s</text>'
        )
    stride = max(1, math.ceil(len(times) / _MOST_POINTS))
    for number, (label, values, colour) in enumerate(curves):
        points = " ".join(
            f"{x(time):.1f},{y(value):.1f}"
            for time, value in zip(times[::stride].tolist(), values[::stride].tolist(), strict=True)
        )
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}"/>')
        parts.append(
            f'<text x="{_LEFT + _WIDTH + 12}" y="{top + 16 + 18 * number}" fill="{colour}">'
            f"{escape(label)}</text>"
        )
    return parts


def _line(x: float, y: float, right: float, bottom: float) -> str:
    return f'<line x1="{x:.1f}" y1="{y:.1f}" x2="{right:.1f}" y2="{bottom:.1f}" stroke="{_GRID}"/>'


def _ticks(lowest: float, highest: float) -> list[float]:
    """Return about five round numbers between two."""
    span = max(highest - lowest, 1e-6)
    rough = span / 5.0
    unit = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * unit for factor in (1.0, 2.0, 5.0, 10.0) if factor * unit >= rough)
    first = math.ceil(lowest / step - 1e-9)
    count = math.floor((highest - first * step) / step + 1e-9) + 1
    return [round((first + index) * step, 9) for index in range(max(count, 1))]


def _angle(angle: float) -> str:
    return f"{math.degrees(angle):.2f}° ({1e3 * angle:.1f} mrad)"


def _lag(trace: Trace) -> str:
    behind = lag(trace)
    return "the target hardly moves" if behind is None else f"{1e3 * behind:.0f} ms"


def _top(speeds: Array) -> float:
    """Return the 99th percentile of the speeds: one outlier does not count."""
    return float(np.quantile(np.abs(speeds), 0.99))
