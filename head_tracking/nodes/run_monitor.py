"""run_monitor: watches a whole run, for the status line and the summary."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from geometry_msgs.msg import PointStamped
from rclpy.node import Node

from head_tracking.gaze import PanTiltHead
from head_tracking.ros.bus_status import BusStatus
from head_tracking.ros.messages import target_from_message
from head_tracking.status_line import StatusLine
from head_tracking.tf import Buffer
from head_tracking.tracking import Target, TargetPlacer, TrackingJudge

SETTLING = 2.0
"""The head may take so long [s] to find its first target before its error counts."""

_SAMPLE_PERIOD = 0.02  # s
_SHOW_PERIOD = 0.25  # s


@dataclass(frozen=True, slots=True)
class RunSources:
    """Where the monitor looks.

    Attributes:
        head: the head that is turned, once it is known.
        bus_status: the servo bus.
        true_position: where a joint really is [rad]; None where only encoders tell.
    """

    head: Callable[[], PanTiltHead | None]
    bus_status: Callable[[], BusStatus]
    true_position: Callable[[str], float] | None = None


class RunMonitorNode(Node):
    """Judges the head by where its target was, and by where its joints really were then."""

    def __init__(
        self, buffer: Buffer, sources: RunSources, line: StatusLine, **options: Any
    ) -> None:
        super().__init__("run_monitor", **options)
        self._buffer = buffer.core
        self._sources = sources
        self._line = line
        self._placer: TargetPlacer | None = None
        self._target: Target | None = None
        self._judge: TrackingJudge | None = None
        self.create_subscription(PointStamped, "target_point", self._on_target, 10)
        self.create_timer(_SAMPLE_PERIOD, self._sample)
        self.create_timer(_SHOW_PERIOD, lambda: self._line.show(self.status()))

    @property
    def _now(self) -> float:
        return float(self.get_clock().now().nanoseconds) * 1e-9

    def _on_target(self, message: PointStamped) -> None:
        head = self._sources.head()
        if head is None:
            return
        if self._placer is None:
            self._placer = TargetPlacer(self._buffer, head.base_frame, SETTLING)
            self._judge = TrackingJudge(head, SETTLING)
        self._placer.offer(target_from_message(message), self._now)

    def _sample(self) -> None:
        head = self._sources.head()
        if head is None or self._placer is None or self._judge is None:
            return
        now, positions = self._now, self._positions(head)
        if positions is not None:
            self._judge.joints_stand(now, positions)
        # (what is refused is left to the node that turns the head)
        for target, point in self._placer.place(now, {}):
            self._target = target
            self._judge.target_seen(target.stamp * 1e-9 if target.stamp else now, point)

    def _positions(self, head: PanTiltHead) -> tuple[float, float] | None:
        found = [self._position(joint) for joint in (head.pan_joint, head.tilt_joint)]
        pan, tilt = found
        return None if pan is None or tilt is None else (pan, tilt)

    def _position(self, joint: str) -> float | None:
        if self._sources.true_position is not None:
            return self._sources.true_position(joint)
        state = self._sources.bus_status().states.get(joint)
        return None if state is None else state.position

    def status(self) -> str:
        """One line: joints, target, error, bus rate and temperatures."""
        bus = self._sources.bus_status()
        head = self._sources.head()
        positions = None if head is None else self._positions(head)
        error = None if self._judge is None else self._judge.error
        temperatures = " ".join(f"{state.temperature:.0f}" for state in bus.states.values())
        return " | ".join(
            (
                "waiting for the head"
                if positions is None
                else f"pan {_degrees(positions[0])} tilt {_degrees(positions[1])}",
                "no target" if self._target is None else f"target {self._target}",
                "error    - " if error is None else f"error {_degrees(error, '')}",
                f"bus {bus.in_short}",
                f"{temperatures or '-'} °C",
            )
        )

    def summary(self) -> str:
        """One line on the whole run."""
        bus = self._sources.bus_status()
        counted = f"{bus.statistics.cycles} bus cycles, {bus.faults} faults"
        if not bus.statistics.connected:
            counted += ", the adapter has gone"
        statistics = None if self._judge is None else self._judge.statistics
        if statistics is None or not statistics.count:
            return f"no target was followed; {counted}"
        judge = "measured" if self._sources.true_position is None else "true"
        return (
            f"tracking error {math.degrees(statistics.rms):.2f}° rms, "
            f"{math.degrees(statistics.maximum):.2f}° max by the {judge} servo angles over "
            f"{statistics.count * _SAMPLE_PERIOD:.1f} s; {counted}"
        )


def _degrees(angle: float, sign: str = "+") -> str:
    return f"{math.degrees(angle):{sign}6.1f}°"
