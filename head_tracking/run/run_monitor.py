"""Watches a whole run, for the status line and the summary."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

from head_tracking.dynamixel import (
    BusStatistics,
    BusThread,
    BusTiming,
    Health,
    ServoStatistics,
    Torque,
)
from head_tracking.gaze import PanTiltHead
from head_tracking.head.head_control import HeadControl
from head_tracking.tracking import ErrorStatistics, TrackingJudge

_SETTLING_TIME = 2.0  # s from the first target until the tracking error counts


class RunMonitor:
    """Computes the tracking error of a run, and describes its state.

    Args:
        head: the controller of the head; None: the run has none.
        true_position: returns the true position of a joint [rad]; None: only measured ones exist.
    """

    def __init__(
        self,
        head: HeadControl | None,
        buses: Sequence[BusThread],
        true_position: Callable[[str], float] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._head, self._buses, self._true_position = head, buses, true_position
        self._clock = clock
        self._judge: TrackingJudge | None = None
        self._statistics = ErrorStatistics()
        self._judged_time = 0.0  # s
        self._last_update = clock()

    def update(self) -> list[str]:
        """Include what has happened since the last call; return the parts of the status."""
        control, positions = self._head, None
        buses = [thread.bus.statistics() for thread in self._buses]
        measured = [  # the servos that answered in the latest cycle
            servo
            for bus in buses
            for servo in bus.servos
            if servo.health in (Health.PRESENT, Health.FAULTED)
        ]
        if control is not None and control.frames.head is not None:
            positions = self._positions(measured, control.joints)
            if positions is not None:
                torque = {each.torque for each in measured if each.joint_name in control.joints}
                if Torque.OFF_ON_REQUEST.value in torque:
                    self._judge = None  # the error counts from a while after it holds again
                self._judge_head(control, control.frames.head, positions)
        self._last_update = self._clock()
        target = None if control is None else control.frames.target
        error = None if self._judge is None or positions is None else self._judge.error
        temperatures = " ".join(f"{servo.temperature:.0f}" for servo in measured)
        return [
            "error   - " if error is None else f"error {math.degrees(error):4.1f}°",
            "waiting for the head"
            if positions is None
            else f"pan {_degrees(positions[0])} tilt {_degrees(positions[1])}",
            "no target" if target is None else f"target {target}",
            f"bus {', '.join(map(_in_short, buses, (thread.timing for thread in self._buses)))}",
            f"{temperatures or '-'} °C",
        ]

    def _judge_head(
        self, control: HeadControl, head: PanTiltHead, positions: tuple[float, float]
    ) -> None:
        if self._judge is None or self._judge.head is not head:
            self._judge = TrackingJudge(head, _SETTLING_TIME, statistics=self._statistics)
        # the slow motion after a STOP does not count
        self._judge.settling = math.inf if control.is_cautious else _SETTLING_TIME
        before = self._statistics.count
        if control.error is None:
            self._judge.target_lost(control.now)
        self._judge.joints_read(control.now, positions)
        for stamp, point in control.frames.take_recent():
            self._judge.target_seen(stamp, point)
        if self._statistics.count > before:
            self._judged_time += self._clock() - self._last_update

    def _positions(
        self, measured: Sequence[ServoStatistics], joints: tuple[str, str]
    ) -> tuple[float, float] | None:
        """Return pan and tilt [rad]; None if a servo has not been measured, or there is none."""
        try:
            if self._true_position is not None:
                pan, tilt = map(self._true_position, joints)
            else:
                positions = {servo.joint_name: servo.position for servo in reversed(measured)}
                pan, tilt = (positions[joint] for joint in joints)
        except KeyError:
            return None
        return pan, tilt

    def summary(self) -> str:
        """Return the result of the whole run: tracking error, bus cycles, faults."""
        buses = [thread.bus.statistics() for thread in self._buses]
        faults = sum(bus.faults for bus in buses)
        counts = f"{min(bus.cycles for bus in buses)} bus cycles, {faults} faults"
        if not all(bus.connected for bus in buses):
            counts += ", the adapter is disconnected"
        statistics = self._statistics
        if not statistics.count:
            return f"no target was followed for more than {_SETTLING_TIME:g} s; {counts}"
        source = "measured" if self._true_position is None else "true"
        return (
            f"tracking error {math.degrees(statistics.rms):.2f}° rms, "
            f"{math.degrees(statistics.maximum):.2f}° max by the {source} servo angles over "
            f"{self._judged_time:.1f} s; {counts}"
        )


def _in_short(bus: BusStatistics, timing: BusTiming) -> str:
    """Return the state of a bus in a few words, such as "50 Hz"."""
    if not bus.connected:
        return "unplugged"
    silent = sum(servo.health in (Health.UNKNOWN, Health.LOST) for servo in bus.servos)
    if silent:
        return f"{silent} of {len(bus.servos)} servos silent"
    return f"{timing.reached_rate:.0f} Hz"


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):+6.1f}°"
