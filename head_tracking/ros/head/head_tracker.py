"""head_tracker: keeps the head on a moving target."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from head_tracking.configuration.head_nodes import HeadTrackerParameters
from head_tracking.control import ControlLoop
from head_tracking.head.motions import Tracking, TrackingSettings
from head_tracking.head.obstacle import Blocked
from head_tracking.ros.head.head_node import HeadNode
from head_tracking.ros.kit.diagnostics import Level, report
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.spinning import steady_timer
from head_tracking.tracking import (
    LAWS,
    EstimatorParameters,
    LearningParameters,
    SpeedLimits,
    TargetState,
    TargetStateParameters,
)

_DIAGNOSTICS_PERIOD = 1.0  # s


class HeadTrackerNode(HeadNode):
    """Keeps the head on `target_point`.

    Args:
        loop: the control loop of the process; None: this node listens itself, and runs its own.
    """

    logs_states = True

    def __init__(self, loop: ControlLoop | None = None, **options: Any) -> None:
        super().__init__("head_tracker", **options)
        own = self._own = NodeParameters(self, HeadTrackerParameters, on_change=self._tune)
        self._limits = NodeParameters(self, SpeedLimits, on_change=self._tune)
        self._laws = {
            name: NodeParameters(self, law.Parameters, on_change=self._tune)
            for name, law in LAWS.items()
        }
        self._estimator = NodeParameters(self, EstimatorParameters, on_change=self._tune)
        self._target_state = NodeParameters(self, TargetStateParameters, on_change=self._tune)
        self._learning = NodeParameters(self, LearningParameters, on_change=self._tune)
        self._tracking = Tracking(self._settings())
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        period = 1.0 / own.value.rate
        self.create_control("~/tracking_error", loop, self._tracking, period)
        steady_timer(self, _DIAGNOSTICS_PERIOD, self._publish_diagnostics)

    def _settings(self) -> TrackingSettings:
        own = self._own.value
        law = own.law
        return TrackingSettings(
            law,
            self._limits.value,
            self._laws[law].value,
            self._estimator.value,
            self._target_state.value,
            self._learning.value,
        )

    def _tune(self, _: object) -> None:
        with self.control.lock:
            self._tracking.tune(self._settings())

    def _measured(self) -> dict[str, str]:
        """Return the measured delays, for `/diagnostics`."""
        tracker = self._tracking.tracker
        if tracker is None:
            return {}
        interval, now = tracker.interval, self.control.now
        return {
            "targets per second": f"{1.0 / interval:.1f}" if interval else "-",
            "age of a target (ms)": f"{1e3 * tracker.message_age:.1f}",
            "age of the joint states (ms)": f"{1e3 * tracker.reading_age:.1f}",
            **{name: value.described(now) for name, value in tracker.learned.items()},
        }

    def _publish_diagnostics(self) -> None:
        control = self.control
        with control.lock:
            values = {"law": self._own.value.law, **self._measured()}
            state, text = control.state()
        has_problem = control.trouble is not None or state == TargetState.STALLED
        level = Level.WARN if has_problem else Level.OK
        if control.off is not None and control.off.reason is Blocked.FAULT:
            level = Level.ERROR
        self._diagnostics.publish(report(self, "target", level, text, values))
