"""Watches a whole run, for the status line and the summary."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from head_tracking.head.head_control import HeadControl
from head_tracking.ros.bus.bus_status import BusStatus
from head_tracking.run.status_line import Mood
from head_tracking.tracking import ErrorStatistics, TrackingJudge

_ON_TARGET = math.radians(2.0)

SETTLING = 2.0
"""The head may take so long [s] to find its first target before its error counts."""


class RunMonitor:
    """Judges the head by where its target was, and by where its joints really were then.

    Args:
        head: what turns the head; None: there is none in this run.
        bus_status: of the servo bus.
        true_position: where a joint really is [rad]; None where only encoders tell.
        is_stopped: whether somebody has stopped the head.
        clock: steady time [s].
    """

    def __init__(
        self,
        head: HeadControl | None,
        bus_status: Callable[[], BusStatus],
        true_position: Callable[[str], float | None] | None = None,
        is_stopped: Callable[[], bool] = bool,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._head, self._bus_status, self._true_position = head, bus_status, true_position
        self._is_stopped, self._clock = is_stopped, clock
        self._judge: TrackingJudge | None = None
        self._statistics = ErrorStatistics()
        self._judged = 0.0  # s
        self._looked = clock()
        self._stops = 0
        self._stopped = False

    def look(self) -> tuple[list[str], Mood]:
        """Takes what has come since this was asked last; the status line's parts and mood."""
        stopped = self._is_stopped()
        self._stops += stopped and not self._stopped
        self._stopped = stopped
        control, positions = self._head, self._positions()
        head = None if control is None else control.head
        if control is not None and head is not None and positions is not None:
            if self._judge is None or self._judge.head is not head:
                self._judge = TrackingJudge(head, SETTLING, statistics=self._statistics)
            before = self._statistics.count
            self._judge.joints_read(control.now, positions)
            for stamp, point in control.take_placed():
                self._judge.target_seen(stamp, point)
            if self._statistics.count > before:
                self._judged += self._clock() - self._looked
        self._looked = self._clock()
        return self._status(positions)

    def _positions(self) -> tuple[float, float] | None:
        if self._head is None or self._head.head is None:
            return None
        pan, tilt = (self._position(joint) for joint in self._head.joints)
        return None if pan is None or tilt is None else (pan, tilt)

    def _position(self, joint: str) -> float | None:
        state = self._bus_status().states.get(joint)
        if self._true_position is not None:
            return self._true_position(joint)
        return None if state is None else state.position

    def _status(self, positions: tuple[float, float] | None) -> tuple[list[str], Mood]:
        bus, head = self._bus_status(), self._head
        target = None if head is None else head.target
        error = None if self._judge is None else self._judge.error
        missed = "error   - " if error is None else f"error {math.degrees(error):4.1f}°"
        temperatures = " ".join(f"{state.temperature:.0f}" for state in bus.states.values())
        parts = [
            missed,
            "waiting for the head"
            if positions is None
            else f"pan {_degrees(positions[0])} tilt {_degrees(positions[1])}",
            "no target" if target is None else f"target {target}",
            f"bus {bus.in_short}",
            f"{temperatures or '-'} °C",
        ]
        if self._stopped:
            return ["STOPPED", *parts], Mood.BAD
        if not bus.statistics.connected:
            return parts, Mood.BAD
        if error is None:
            return parts, Mood.PLAIN
        return parts, Mood.GOOD if error < _ON_TARGET else Mood.WATCH

    def summary(self) -> str:
        """What has come of the whole run, the tracking error and the bus on the last line."""
        bus = self._bus_status()
        counted = f"{bus.statistics.cycles} bus cycles, {bus.faults} faults"
        if self._stops:
            counted += f", stopped {self._stops} times" if self._stops > 1 else ", stopped once"
        if not bus.statistics.connected:
            counted += ", the adapter has gone"
        statistics = self._statistics
        if not statistics.count:
            return f"no target was followed; {counted}"
        judge = "measured" if self._true_position is None else "true"
        return (
            f"tracking error {math.degrees(statistics.rms):.2f}° rms, "
            f"{math.degrees(statistics.maximum):.2f}° max by the {judge} servo angles over "
            f"{self._judged:.1f} s; {counted}"
        )


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):+6.1f}°"
