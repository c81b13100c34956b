"""head_tracker: keeps the head on a moving target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from head_tracking.gaze import PanTiltHead
from head_tracking.nodes.head_interface import HeadInterface
from head_tracking.nodes.parameters import NodeParameters
from head_tracking.nodes.spinning import run_node
from head_tracking.nodes.tracker_diagnostics import tracker_diagnostics
from head_tracking.parameters import parameter
from head_tracking.tf import Buffer
from head_tracking.tf.qos import LATCHED
from head_tracking.tracking import (
    LAWS,
    EstimatorParameters,
    LawParameters,
    LifeCycleParameters,
    PredictiveLawParameters,
    SpeedLawParameters,
    SpeedLimits,
    Target,
    Tracker,
    Verdict,
)

_DIAGNOSTICS_PERIOD = 1.0  # s


@dataclass(frozen=True, slots=True)
class HeadTrackerParameters:
    """What to point, how, and how often to correct it."""

    camera_link: str = parameter("camera_link", "The frame to point.", fixed=True)
    rate: float = parameter(
        50.0, "Commands per second.", unit="Hz", minimum=1.0, maximum=200.0, fixed=True
    )
    law: str = parameter(
        "predictive",
        "What steers the head: with the target's motion, by the tutorials' speeds, or straight "
        "to the newest point.",
        choices=tuple(LAWS),
    )


class HeadTrackerNode(Node):
    """Follows `target_point`."""

    def __init__(self, buffer: Buffer | None = None, **options: Any) -> None:
        super().__init__("head_tracker", **options)
        self._own = NodeParameters(self, HeadTrackerParameters, on_change=self._on_own)
        self._limits = NodeParameters(self, SpeedLimits, on_change=self._tune)
        self._speed = NodeParameters(self, SpeedLawParameters, on_change=self._tune)
        self._predictive = NodeParameters(self, PredictiveLawParameters, on_change=self._tune)
        self._estimator = NodeParameters(self, EstimatorParameters, on_change=self._tune)
        self._life_cycle = NodeParameters(self, LifeCycleParameters, on_change=self._tune)
        self._law = self._own.value.law
        self._period = 1.0 / self._own.value.rate
        self._tracker: Tracker | None = None
        self._state = ""
        self._states = self.create_publisher(String, "~/state", LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._interface = HeadInterface(
            self, self._own.value.camera_link, "~/tracking_error", buffer, self._on_head
        )
        self.create_service(SetBool, "~/enable", self._on_enable)
        self.create_service(Trigger, "~/recenter", self._on_recenter)
        self.create_timer(self._period, self._step)
        self.create_timer(_DIAGNOSTICS_PERIOD, self._publish_diagnostics)

    @property
    def head(self) -> PanTiltHead | None:
        """The head that is turned, once the robot's model is known."""
        return None if self._tracker is None else self._tracker.head

    def _on_head(self, head: PanTiltHead) -> None:
        law = LAWS[self._law](head, self._period, self._law_parameters)
        self._tracker = Tracker(head, law, self._estimator.value, self._life_cycle.value)
        self.get_logger().info(
            f"ready to keep {head.pointing_frame} on target_point, by the law {self._law}"
        )

    @property
    def _law_parameters(self) -> LawParameters:
        return LawParameters(self._limits.value, self._speed.value, self._predictive.value)

    def _on_own(self, parameters: HeadTrackerParameters) -> None:
        if parameters.law == self._law:
            return
        self._law = parameters.law
        if self._tracker is not None:
            head = self._tracker.head
            self._tracker.law = LAWS[self._law](head, self._period, self._law_parameters)
        self.get_logger().info(f"the head is steered by the law {self._law} from now on")

    def _tune(self, _: object) -> None:
        if self._tracker is not None:
            self._tracker.law.parameters = self._law_parameters
            self._tracker.estimator.parameters = self._estimator.value
            self._tracker.life_cycle.parameters = self._life_cycle.value

    def _step(self) -> None:
        if not self._interface.ready() or self._tracker is None:
            return
        reading = self._interface.reading()
        if reading is None:
            return
        tracker, (pan, tilt) = self._tracker, reading[1]
        tracker.joints_read(*reading)
        head = tracker.head
        placed = self._interface.take_targets({head.pan_joint: pan, head.tilt_joint: tilt})
        for target, point in placed:
            now = self._interface.now
            stamp = target.stamp * 1e-9 if target.stamp else now
            self._report(target, tracker.target_seen(stamp, point, now))
        step = tracker.step(self._interface.now)
        self._interface.send(step.command)
        self._interface.publish_error(step.error)
        self._report_state(tracker)

    def _report(self, target: Target, verdict: Verdict) -> None:
        if verdict in (Verdict.FUTURE, Verdict.TOO_OLD):
            self.get_logger().warning(f"{target}: {verdict}", throttle_duration_sec=2.0)

    def _report_state(self, tracker: Tracker) -> None:
        life = tracker.life_cycle
        text = f"{life.state}: {life.reason}"
        if text == self._state:
            return
        if not self._state.startswith(f"{life.state}:"):
            self.get_logger().info(text)
        self._state = text
        self._states.publish(String(data=text))

    def _publish_diagnostics(self) -> None:
        if self._tracker is not None:
            message = tracker_diagnostics(self._state, self._law, self._tracker.delays)
            message.header.stamp = self.get_clock().now().to_msg()
            self._diagnostics.publish(message)

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if not self._interface.ready() or self._tracker is None:
            response.message = "there is no model of the robot yet"
            return response
        self._interface.forget_targets()
        reading = self._interface.reading()
        if reading is not None:
            self._tracker.joints_read(*reading)
        self._interface.send(self._tracker.enable(request.data, self._interface.now))
        self._report_state(self._tracker)
        response.success = True
        response.message = "tracking is on" if request.data else "tracking is off; the head stops"
        return response

    def _on_recenter(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        present = self._interface.positions() if self._interface.ready() else None
        if present is None or self._tracker is None:
            response.message = "the head cannot be recentred: there is no model or no joint state"
            return response
        if not self._tracker.life_cycle.enabled:
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
