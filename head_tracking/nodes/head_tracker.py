"""head_tracker: keeps the head on a moving target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from head_tracking.gaze import PanTiltHead
from head_tracking.parameters import parameter
from head_tracking.ros.head_interface import HeadInterface
from head_tracking.ros.parameters import NodeParameters
from head_tracking.ros.spinning import run_node, steady_timer
from head_tracking.tf import Buffer
from head_tracking.tf.qos import LATCHED
from head_tracking.tracking import (
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
_STATE_PERIOD = 0.25  # s


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
    """Follows `target_point`."""

    def __init__(self, buffer: Buffer | None = None, **options: Any) -> None:
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
        self._period = 1.0 / self._own.value.rate
        self._stepped = 0.0
        self._tracker: Tracker | None = None
        self._state, self._text = TargetState.IDLE, ""
        self._states = self.create_publisher(String, "~/state", LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._interface = HeadInterface(
            self,
            self._own.value.camera_link,
            "~/tracking_error",
            buffer,
            self._on_head,
            self._reset,
        )
        self.create_service(SetBool, "~/enable", self._on_enable)
        self.create_service(Trigger, "~/recenter", self._on_recenter)
        steady_timer(self, self._period, self._step)
        steady_timer(self, _STATE_PERIOD, self._report_state)
        steady_timer(self, _DIAGNOSTICS_PERIOD, self._publish_diagnostics)

    @property
    def head(self) -> PanTiltHead | None:
        """The head that is turned, once the robot's model is known."""
        return None if self._tracker is None else self._tracker.head

    def _on_head(self, head: PanTiltHead, base: HeadBase | None) -> None:
        tracker = Tracker(
            head, self._make_law(head), self._estimator.value, self._target_state.value, base
        )
        if self._tracker is not None:
            self._reset("another robot_description has come")
            tracker.machine.enabled = self._tracker.machine.enabled
        self._tracker = tracker
        self.get_logger().info(
            f"ready to keep {head.pointing_frame} on target_point, by the law {self._law}"
        )

    def _reset(self, reason: str) -> None:
        if self._tracker is not None:
            self._interface.send(self._tracker.reset(reason, self._interface.now))
            self._report_state()

    def _make_law(self, head: PanTiltHead) -> TrackingLaw:
        own = self._laws[self._law].value
        return LAWS[self._law](head, self._period, self._limits.value, own)

    def _on_own(self, parameters: HeadTrackerParameters) -> None:
        if parameters.law == self._law:
            return
        self._law = parameters.law
        if self._tracker is not None:
            self._tracker.law = self._make_law(self._tracker.head)
        self.get_logger().info(f"the head is steered by the law {self._law} from now on")

    def _tune(self, _: object) -> None:
        if self._tracker is not None:
            self._tracker.law.limits = self._limits.value
            self._tracker.law.parameters = self._laws[self._law].value
            self._tracker.estimator.parameters = self._estimator.value
            self._tracker.machine.parameters = self._target_state.value

    def _step(self) -> None:
        reading, tracker = self._interface.reading(), self._tracker
        if reading is None or tracker is None:
            return
        now, stamp, positions = reading
        if 0.0 <= now - self._stepped < 0.5 * self._period:
            return  # simulated time is slow, or stands still
        self._stepped = now
        tracker.joints_read(stamp, positions)
        for target, point in self._interface.take_targets(positions, now):
            verdict = tracker.target_seen(
                target.stamp * 1e-9 if target.stamp else now,
                point,
                now,
                moving=bool(target.stamp) and self._interface.moves_with_head(target.frame_id),
            )
            if not verdict.used and tracker.machine.refusal == verdict:
                self._interface.refuse(Refusal(target, verdict))
        refused = self._interface.take_refusal()
        if refused:
            tracker.machine.refused(refused, now)
        step = tracker.step(now)
        self._interface.send(step.command)
        self._interface.publish_error(step.error)
        self._report_state()

    def _report_state(self) -> None:
        trouble = self._interface.trouble
        if self._tracker is None or (trouble and self._tracker.machine.enabled):
            state, reason = TargetState.IDLE, trouble
        else:
            state, reason = self._tracker.machine.state, self._tracker.machine.reason
        text = f"{state}: {reason}"
        if text == self._text:
            return
        if not self._text.startswith(f"{state}:"):
            self.get_logger().info(text)
        self._state, self._text = state, text
        self._states.publish(String(data=text))

    def _publish_diagnostics(self) -> None:
        """What the head does, by which law, and how late everything is."""
        values = {"law": self._law}
        if self._tracker is not None:
            delays = self._tracker.delays
            pan, tilt = delays.servos
            values |= {
                "targets per second": f"{1.0 / delays.interval:.1f}" if delays.interval else "-",
                "age of a target (ms)": f"{1e3 * delays.message:.1f}",
                "age of the joint states (ms)": f"{1e3 * delays.reading:.1f}",
                "pan servo's delay (ms)": f"{1e3 * pan:.1f}",
                "tilt servo's delay (ms)": f"{1e3 * tilt:.1f}",
                "stamps of the camera too late by (ms)": (
                    f"{1e3 * self._tracker.stamp_error.value:.0f}"
                ),
            }
        hampered = self._interface.trouble or self._state in (
            TargetState.STALLED,
            TargetState.CAUTIOUS,
        )
        status = DiagnosticStatus(
            name="head_tracker: target",
            level=DiagnosticStatus.WARN if hampered else DiagnosticStatus.OK,
            message=self._text,
            hardware_id="head",
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        reading = self._interface.reading()
        if self._tracker is None:
            response.message = "there is no model of the robot yet"
            return response
        self._interface.forget_targets()
        if reading is not None:
            self._tracker.joints_read(reading.stamp, reading.positions)
        self._interface.send(self._tracker.enable(request.data, self._interface.now))
        self._report_state()
        response.success = True
        response.message = "tracking is on" if request.data else "tracking is off; the head stops"
        return response

    def _on_recenter(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._interface.reading() is None or self._tracker is None:
            response.message = "the head cannot be recentred: there is no model or no joint state"
            return response
        if not self._tracker.machine.enabled:
            response.message = "the head cannot be recentred: tracking is switched off"
            return response
        self._interface.forget_targets()
        self._tracker.recenter()
        response.success = True
        response.message = "recentring; the next target is followed again"
        return response


def main() -> int:
    """Runs the node until it is interrupted."""
    return run_node(HeadTrackerNode)


if __name__ == "__main__":
    raise SystemExit(main())
