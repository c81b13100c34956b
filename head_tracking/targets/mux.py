"""Choose one of several sources of targets, and change over smoothly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from head_tracking.parameters import parameter
from head_tracking.transforms import Vector3


@dataclass(frozen=True, slots=True)
class SourceParameters:
    """One source of targets."""

    topic: str = parameter("", "Its topic; empty: <name>/target_point.", fixed=True, ros_name=True)
    type: str = parameter(
        "point",
        "PointStamped, or PoseStamped (its position).",
        choices=("point", "pose"),
        fixed=True,
    )
    priority: int = parameter(
        0,
        "The source with the highest priority and a valid target is selected.",
        minimum=-1000,
        maximum=1000,
        fixed=True,
    )
    timeout: float = parameter(
        0.5,
        "A target is valid for this time after its arrival.",
        unit="s",
        minimum=0.01,
        maximum=36000.0,
        fixed=True,
    )
    repeat: bool = parameter(
        False,
        "Repeat the last target until the timeout, for sources that publish once.",
        fixed=True,
    )


@dataclass(frozen=True, slots=True)
class MuxParameters:
    """Hysteresis of the choice."""

    take_over_time: float = parameter(
        0.5,
        "A source of higher priority must have a target for this time to be chosen.",
        unit="s",
        minimum=0.0,
        maximum=60.0,
    )


class TargetMux:
    """Choose a source by priority, with time-outs and hysteresis.

    The chosen source stays chosen while it has a target, unless a source of higher priority has had
    one for the take-over time. When it has no target any more, the source of the highest priority
    that has one is chosen at once. Times are in seconds, on any clock.

    Args:
        sources: by name.
        parameters: may be changed at any time.
    """

    def __init__(self, sources: Mapping[str, SourceParameters], parameters: MuxParameters) -> None:
        self.sources, self.parameters = sources, parameters
        self._first = dict.fromkeys(self.sources, -math.inf)
        self._last = dict.fromkeys(self.sources, -math.inf)
        self._selected: str | None = None
        self.pinned: str | None = None

    def pin(self, name: str | None) -> None:
        """Choose one source only, whether it has a target or not; None: choose by priority.

        Raises:
            ValueError: there is no such source.
        """
        if name is not None and name not in self.sources:
            raise ValueError(f"there is no source {name!r}; there are {', '.join(self.sources)}")
        self.pinned = name

    def offer(self, name: str, now: float) -> str | None:
        """Record a target of a source; return the chosen source."""
        if not self._fresh(name, now):
            self._first[name] = now
        self._last[name] = now
        return self.select(now)

    def select(self, now: float) -> str | None:
        """Return the chosen source; None: no source has a target."""
        if self.pinned is not None:
            self._selected = self.pinned if self._fresh(self.pinned, now) else None
            return self._selected
        fresh = [name for name in self.sources if self._fresh(name, now)]
        if self._selected not in fresh:
            self._selected = max(fresh, key=self._priority, default=None)
            return self._selected
        steady = [
            name
            for name in fresh
            if name == self._selected or self._age(name, now) >= self.parameters.take_over_time
        ]
        best = max(steady, key=self._priority)
        if self._priority(best) > self._priority(self._selected):
            self._selected = best
        return self._selected

    def _age(self, name: str, now: float) -> float:
        """Return for how long a source has had a target, by its last one [s]."""
        last = now if self.sources[name].repeat else self._last[name]
        return last - self._first[name]

    def _fresh(self, name: str, now: float) -> bool:
        # below 0: the clock has jumped back
        return 0.0 <= now - self._last[name] <= self.sources[name].timeout

    def _priority(self, name: str) -> int:
        return self.sources[name].priority


def between(start: Vector3, end: Vector3, ratio: float, centre: Vector3) -> Vector3:
    """Return a point on a path around the head from one target to the next, with smooth ends.

    Azimuth, elevation and distance from a centre are interpolated, so that the path passes in front
    of the robot, and not through the head.

    Args:
        start: the former target [m].
        end: the next target [m].
        ratio: share of the duration that has passed, 0 to 1.
        centre: position of the head [m].
    """
    ratio = ratio * ratio * (3.0 - 2.0 * ratio)  # velocity 0 at both ends
    here, there = _spherical(start, centre), _spherical(end, centre)
    return _point(tuple(a + ratio * (b - a) for a, b in zip(here, there, strict=True)), centre)


def _spherical(point: Vector3, centre: Vector3) -> Vector3:
    x, y, z = (a - b for a, b in zip(point, centre, strict=True))
    flat = math.hypot(x, y)
    return math.atan2(y, x), math.atan2(z, flat), math.hypot(flat, z)


def _point(spherical: tuple[float, ...], centre: Vector3) -> Vector3:
    azimuth, elevation, distance = spherical
    flat = distance * math.cos(elevation)
    return (
        centre[0] + flat * math.cos(azimuth),
        centre[1] + flat * math.sin(azimuth),
        centre[2] + distance * math.sin(elevation),
    )
