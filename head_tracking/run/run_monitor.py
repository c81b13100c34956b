"""Watches a whole run, for the status line and the summary."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from head_tracking.gaze import PanTiltHead
from head_tracking.head.head_control import HeadControl
from head_tracking.ros.bus.bus_status import BusStatus
from head_tracking.tracking import ErrorStatistics, TargetState, TrackingJudge

_GIVEN_UP = (
    TargetState.DISABLED,
    TargetState.IDLE,
    TargetState.RECENTERING,
    TargetState.SEARCHING,
)

_SETTLING_TIME = 2.0  # s from the first target until the tracking error counts


class RunMonitor:
    """Computes the tracking error of a run, and describes its state.

    Args:
        head: the controller of the head; None: the run has none.
        bus_status: returns the status of the servo bus.
        true_position: returns the true position of a joint [rad]; None: only measured ones exist.
        clock: returns steady time [s].
    """

    def __init__(
        self,
        head: HeadControl | None,
        bus_status: Callable[[], BusStatus],
        true_position: Callable[[str], float] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._head, self._bus_status, self._true_position = head, bus_status, true_position
        self._clock = clock
        self._judge: TrackingJudge | None = None
        self._statistics = ErrorStatistics()
        self._judged_time = 0.0  # s
        self._last_update = clock()

    def update(self) -> list[str]:
        """Include what has happened since the last call; return the parts of the status."""
        bus, control, positions = self._bus_status(), self._head, None
        if control is not None and control.frames.head is not None:
            positions = self._positions(bus, control.joints)
            if positions is not None:
                self._judge_head(control, control.frames.head, positions)
        self._last_update = self._clock()
        target = None if control is None else control.frames.target
        error = None if self._judge is None else self._judge.error
        servos = [s for s in bus.statistics.servos if s.joint_name in bus.states]
        temperatures = " ".join(f"{servo.temperature:.0f}" for servo in servos)
        return [
            "error   - " if error is None else f"error {math.degrees(error):4.1f}°",
            "waiting for the head"
            if positions is None
            else f"pan {_degrees(positions[0])} tilt {_degrees(positions[1])}",
            "no target" if target is None else f"target {target}",
            f"bus {bus.in_short}",
            f"{temperatures or '-'} °C",
        ]

    def _judge_head(
        self, control: HeadControl, head: PanTiltHead, positions: tuple[float, float]
    ) -> None:
        """Judge pan and tilt, and the targets since the last call."""
        if self._judge is None or self._judge.head is not head:
            self._judge = TrackingJudge(head, _SETTLING_TIME, statistics=self._statistics)
        before = self._statistics.count
        if control.state()[0] in _GIVEN_UP:
            self._judge.target_lost(control.now)
        self._judge.joints_read(control.now, positions)
        for stamp, point in control.frames.take_recent():
            self._judge.target_seen(stamp, point)
        if self._statistics.count > before:
            self._judged_time += self._clock() - self._last_update

    def _positions(self, bus: BusStatus, joints: tuple[str, str]) -> tuple[float, float] | None:
        """Return pan and tilt [rad]; None if a servo has not been measured, or there is none."""
        try:
            if self._true_position is not None:
                pan, tilt = map(self._true_position, joints)
            else:
                pan, tilt = (bus.states[joint].position for joint in joints)
        except KeyError:
            return None
        return pan, tilt

    def summary(self) -> str:
        """Return the result of the whole run: tracking error, bus cycles, faults."""
        bus = self._bus_status()
        counts = f"{bus.statistics.cycles} bus cycles, {bus.faults} faults"
        if not bus.statistics.connected:
            counts += ", the adapter is disconnected"
        statistics = self._statistics
        if not statistics.count:
            return f"no target was followed; {counts}"
        source = "measured" if self._true_position is None else "true"
        return (
            f"tracking error {math.degrees(statistics.rms):.2f}° rms, "
            f"{math.degrees(statistics.maximum):.2f}° max by the {source} servo angles over "
            f"{self._judged_time:.1f} s; {counts}"
        )


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):+6.1f}°"
