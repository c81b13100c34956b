"""head_tracker: keeps the head on a moving target."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from head_tracking.control import ControlLoop
from head_tracking.gaze import AT_GOAL, HeadCommand, PanTiltHead
from head_tracking.parameters import parameter
from head_tracking.ros.diagnostics import in_namespace
from head_tracking.ros.head_interface import HeadInterface, HeadReading, Pace
from head_tracking.ros.parameters import NodeParameters
from head_tracking.ros.spinning import run_node, steady_timer
from head_tracking.tf import Buffer
from head_tracking.tracking import (
    CAUTIOUS_SPEED,
    LAWS,
    EstimatorParameters,
    HeadBase,
    Refusal,
    SpeedLimits,
    TargetState,
    TargetStateParameters,
    Tracker,
    TrackingLaw,
)

_DIAGNOSTICS_PERIOD = 1.0  # s
_SLOW_TIME = 2.0  # s; so long a head that has a target is slow after a stop, and then less and less
_FAST = 3.0  # rad/s; as fast a head is not slow
_KNOWN = 0.05  # s; a stamp error with a larger deviation is not shown


@dataclass(frozen=True, slots=True)
class HeadTrackerParameters:
    """What to point, how, and how often to correct it."""

    camera_link: str = parameter("camera_link", "The frame to point.", fixed=True)
    rate: float = parameter(
        50.0, "Commands per second.", unit="Hz", minimum=1.0, maximum=200.0, fixed=True
    )
    law: str = parameter(
        "predictive",
        "What steers the head: "
        + "; ".join(f"{name}: {law.description}" for name, law in LAWS.items()),
        choices=tuple(LAWS),
    )


class HeadTrackerNode(Node):
    """Follows `target_point`.

    Args:
        buffer: the transforms that the process shares; None: this node listens itself.
        loop: that of the process; None: this node runs it.
    """

    what = "tracking"

    def __init__(
        self, buffer: Buffer | None = None, loop: ControlLoop | None = None, **options: Any
    ) -> None:
        super().__init__("head_tracker", **options)
        self._own = NodeParameters(self, HeadTrackerParameters, on_change=self._on_own)
        self._limits = NodeParameters(self, SpeedLimits, on_change=self._tune)
        self._laws = {
            name: NodeParameters(self, law.Parameters, on_change=self._tune)
            for name, law in LAWS.items()
        }
        self._estimator = NodeParameters(self, EstimatorParameters, on_change=self._tune)
        self._target_state = NodeParameters(self, TargetStateParameters, on_change=self._tune)
        self._law = self._own.value.law
        self._pace = Pace(max(1.0 / self._own.value.rate, loop.period if loop else 0.0))
        self._slow_for = 0.0  # s, with a target
        self._tracker: Tracker | None = None
        self._state: TargetState | None = None
        self._text = ""
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.interface = HeadInterface(
            self, self._own.value.camera_link, "~/tracking_error", buffer, loop, self
        )
        steady_timer(self, _DIAGNOSTICS_PERIOD, self._publish_diagnostics)
        self.interface.begin()

    def destroy_node(self) -> None:
        """Ends its part in the loop."""
        self.interface.close()
        super().destroy_node()

    @property
    def failure(self) -> Exception | None:
        """What has ended its part in the loop."""
        return self.interface.failure

    def head_known(self, head: PanTiltHead, base: HeadBase | None) -> None:
        """See `HeadTurner`."""
        tracker = Tracker(
            head, self._make_law(head), self._estimator.value, self._target_state.value, base
        )
        if self._tracker is not None:
            self.reset("another robot_description has come")
        self._tracker = tracker
        self.switched()
        self.get_logger().info(
            f"ready to keep {head.pointing_frame} on target_point, by the law {self._law}"
        )

    def reset(self, reason: str) -> None:
        """See `HeadTurner`."""
        if self._tracker is not None:
            self.interface.send(self._tracker.reset(reason, self.interface.now))
            self.report()

    def _speed_up(self, tracker: Tracker, error: float) -> None:
        """Ends the slow motion after a stop: on the target, or bit by bit if that runs away."""
        self._slow_for += self._pace.period
        tracker.at_most = CAUTIOUS_SPEED * 2.0 ** max(0.0, self._slow_for - _SLOW_TIME)
        if error < AT_GOAL or tracker.at_most > _FAST:
            self.interface.slow = False
            tracker.at_most = math.inf

    def _make_law(self, head: PanTiltHead) -> TrackingLaw:
        own = self._laws[self._law].value
        return LAWS[self._law](head, self._pace.period, self._limits.value, own)

    def _on_own(self, parameters: HeadTrackerParameters) -> None:
        if parameters.law == self._law:
            return
        with self.interface.lock:
            self._law = parameters.law
            if self._tracker is not None:
                self._tracker.law = self._make_law(self._tracker.head)
        self.get_logger().info(f"the head is steered by the law {self._law} from now on")

    def _tune(self, _: object) -> None:
        if self._tracker is None:
            return
        with self.interface.lock:
            self._tracker.law.limits = self._limits.value
            self._tracker.law.parameters = self._laws[self._law].value
            self._tracker.estimator.parameters = self._estimator.value
            self._tracker.machine.parameters = self._target_state.value

    def step(self, reading: HeadReading) -> HeadCommand | None:
        """See `HeadTurner`."""
        tracker = self._tracker
        now, stamp, positions = reading
        if tracker is None:
            return None
        tracker.joints_read(stamp, positions)
        if not self._pace.due(reading):
            return None
        for target, point in self.interface.take_targets(positions, now):
            verdict = tracker.target_seen(
                target.stamp * 1e-9 if target.stamp else now,
                point,
                now,
                moving=bool(target.stamp) and self.interface.moves_with_head(target.frame_id),
            )
            if not verdict.used and tracker.machine.refusal == verdict:
                self.interface.refuse(Refusal(target, verdict))
        refused = self.interface.take_refusal()
        if refused:
            tracker.machine.refused(refused, now)
        step = tracker.step(now)
        self.interface.tell_error(step.error)
        if tracker.fault and not self.interface.off:
            self.get_logger().error(f"the head is stopped: {tracker.fault}")
            self.interface.send(step.command)
            self.interface.disable(tracker.fault)
            return None
        if self.interface.slow and step.error is not None:
            self._speed_up(tracker, step.error)
        return step.command

    def recenter(self, reading: HeadReading) -> str:
        """See `HeadTurner`."""
        assert self._tracker is not None
        self._tracker.recenter()
        return "recentring; the next target is followed again"

    def switched(self) -> None:
        """See `HeadTurner`."""
        if self._tracker is None:
            return
        off = self.interface.off
        self._tracker.at_most = CAUTIOUS_SPEED if self.interface.slow else math.inf
        self._slow_for = 0.0
        self._tracker.machine.off = off
        self._tracker.enable(not off, self.interface.now)

    def halt(self, reading: HeadReading | None) -> HeadCommand | None:
        """See `HeadTurner`."""
        if self._tracker is None or reading is None:
            return None
        self._tracker.joints_read(reading.stamp, reading.positions)
        return self._tracker.enable(False, reading.now)

    def report(self) -> None:
        """See `HeadTurner`."""
        trouble = self.interface.trouble
        if self._tracker is None or (trouble and self._tracker.machine.enabled):
            state, reason = TargetState.IDLE, trouble
        else:
            state, reason = self._tracker.machine.state, self._tracker.machine.reason
        text = f"{state}: {reason}"
        if self.interface.publish_state(state, text) and state is not self._state:
            self.get_logger().info(text)
        self._state, self._text = state, text

    def _measured(self) -> dict[str, str]:
        """Return how late everything is, for `/diagnostics`."""
        if self._tracker is None:
            return {}
        delays, camera = self._tracker.delays, self._tracker.camera
        pan, tilt = delays.servos
        deviation = camera.stamp_error.deviation
        return {
            "targets per second": f"{1.0 / delays.interval:.1f}" if delays.interval else "-",
            "age of a target (ms)": f"{1e3 * delays.message:.1f}",
            "age of the joint states (ms)": f"{1e3 * delays.reading:.1f}",
            "pan servo's delay (ms)": f"{1e3 * pan:.1f}",
            "tilt servo's delay (ms)": f"{1e3 * tilt:.1f}",
            "stamps of the camera too late by (ms)": (
                f"{1e3 * camera.applied:.0f} ±{1e3 * deviation:.0f}"
                if deviation < _KNOWN
                else "not observable yet"
            ),
        }

    def _publish_diagnostics(self) -> None:
        """What the head does, by which law, and how late everything is."""
        with self.interface.lock:
            values = {"law": self._law, **self._measured()}
        unheard = self.interface.unheard
        if unheard:
            values["not heard"] = unheard
        hampered = self.interface.trouble or unheard or self._state is TargetState.STALLED
        level = DiagnosticStatus.WARN if hampered else DiagnosticStatus.OK
        if self._tracker is not None and self._tracker.fault:
            level = DiagnosticStatus.ERROR
        status = DiagnosticStatus(
            name="head_tracker: target",
            level=level,
            message=self._text,
            hardware_id="head",
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(in_namespace(self, message))


def main() -> int:
    """Runs the node until it is interrupted."""
    return run_node(HeadTrackerNode)


if __name__ == "__main__":
    raise SystemExit(main())
