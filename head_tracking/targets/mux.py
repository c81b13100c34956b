"""Several targets at once: which of them the head looks at."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from head_tracking.parameters import ParameterError, parameter


@dataclass(frozen=True, slots=True)
class Source:
    """Where targets come from.

    Attributes:
        name: what people call it.
        priority: of several sources with a target the one with the highest wins.
        timeout: how long a target counts after it came [s].
    """

    name: str
    priority: int
    timeout: float


@dataclass(frozen=True, slots=True)
class MuxParameters:
    """When to change from one source to another."""

    take_over_time: float = parameter(
        0.5,
        "A more important source has to have a target for so long before the head turns to it.",
        unit="s",
        minimum=0.0,
        maximum=60.0,
    )


class TargetMux:
    """Chooses among sources by priority, with time-outs and hysteresis.

    A source that has the head keeps it while it has targets, unless one of higher priority has had
    targets for the take-over time. When it has none any more, the most important one that has
    takes over at once. Times are in seconds, on any clock.

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
        """Looks at one source only, whether it has a target or not; None: chooses again.

        Raises:
            ValueError: there is no such source.
        """
        if name is not None and name not in self.sources:
            raise ValueError(f"there is no source {name!r}; there are {', '.join(self.sources)}")
        self.pinned = name

    def offer(self, name: str, now: float) -> bool:
        """Notes that a source has a target; whether it is the one to look at."""
        if not self._fresh(name, now):
            self._first[name] = now
        self._last[name] = now
        return self.select(now) == name

    def withdraw(self, name: str) -> None:
        """The source has no target any more."""
        self._last[name] = -math.inf

    def select(self, now: float) -> str | None:
        """The source to look at; None if none has a target."""
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
            if name == self._selected
            or self._last[name] - self._first[name] >= self.parameters.take_over_time
        ]
        best = max(steady, key=self._priority)
        if self._priority(best) > self._priority(self._selected):
            self._selected = best
        return self._selected

    def _fresh(self, name: str, now: float) -> bool:
        # (what lies in the future came before the clock jumped back)
        return 0.0 <= now - self._last[name] <= self.sources[name].timeout

    def _priority(self, name: str) -> int:
        return self.sources[name].priority
