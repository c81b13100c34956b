"""Choose one of several sources of targets."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from head_tracking.parameters import ParameterError, parameter


@dataclass(frozen=True, slots=True)
class Source:
    """A source of targets.

    Attributes:
        name: name of the source.
        priority: the source with the highest priority that has a target is chosen.
        timeout: how long a target is valid after its arrival [s].
        repeat: whether it publishes a target once, which lasts until the timeout.
    """

    name: str
    priority: int
    timeout: float
    repeat: bool = False


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

    Raises:
        ParameterError: there is no source, or two have one name.
    """

    def __init__(self, sources: Iterable[Source], parameters: MuxParameters) -> None:
        self.parameters = parameters
        listed = list(sources)
        self.sources = {source.name: source for source in listed}
        if not listed or len(self.sources) != len(listed):
            raise ParameterError(
                f"the sources are {[source.name for source in listed]}; give at least one, each "
                "with a name of its own"
            )
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

    def offer(self, name: str, now: float) -> bool:
        """Record a target of a source; return whether this source is chosen."""
        if not self._fresh(name, now):
            self._first[name] = now
        self._last[name] = now
        return self.select(now) == name

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
