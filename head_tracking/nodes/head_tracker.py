"""head_tracker: keeps the head on a moving target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from head_tracking.gaze import PanTiltHead
from head_tracking.nodes.head_interface import HeadInterface
from head_tracking.nodes.parameters import NodeParameters
from head_tracking.nodes.spinning import run_node
from head_tracking.parameters import parameter
from head_tracking.tf import Buffer
from head_tracking.tracking import (
    LostTargetParameters,
    LostTargetPolicy,
    SpeedLaw,
    SpeedLawParameters,
    TargetState,
    Tracker,
)


@dataclass(frozen=True, slots=True)
class HeadTrackerParameters:
    """What to point, and how often to correct it."""

    camera_link: str = parameter("camera_link", "The frame to point.", fixed=True)
    rate: float = parameter(
        10.0, "Commands per second.", unit="Hz", minimum=1.0, maximum=200.0, fixed=True
    )


class HeadTrackerNode(Node):
    """Follows `target_point` with the tutorials' speed-based law."""

    def __init__(self, buffer: Buffer | None = None, **options: Any) -> None:
        super().__init__("head_tracker", **options)
        p = NodeParameters(self, HeadTrackerParameters).value
        self._law = NodeParameters(self, SpeedLawParameters, on_change=self._on_parameters)
        self._lost = NodeParameters(self, LostTargetParameters, on_change=self._on_parameters)
        self._tracker: Tracker | None = None
        self._enabled = True
        self._state = TargetState.IDLE
        self._interface = HeadInterface(
            self, p.camera_link, "~/tracking_error", buffer, self._on_head
        )
        self.create_service(SetBool, "~/enable", self._on_enable)
        self.create_service(Trigger, "~/recenter", self._on_recenter)
        self.create_timer(1.0 / p.rate, self._step)

    @property
    def head(self) -> PanTiltHead | None:
        """The head that is turned, once the robot's model is known."""
        return None if self._tracker is None else self._tracker.head

    def _on_head(self, head: PanTiltHead) -> None:
        self._tracker = Tracker(
            head, SpeedLaw(self._law.value), LostTargetPolicy(head, self._lost.value)
        )
        self.get_logger().info(f"ready to keep {head.pointing_frame} on target_point")

    def _on_parameters(self, _: SpeedLawParameters | LostTargetParameters) -> None:
        if self._tracker is not None:
            self._tracker.law.parameters = self._law.value
            self._tracker.lost_target.parameters = self._lost.value

    def _step(self) -> None:
        if not self._interface.ready() or self._tracker is None:
            return
        present = self._interface.positions()
        if present is None:
            return
        head, now = self._tracker.head, self._interface.now
        placed = self._interface.take_target(
            {head.pan_joint: present[0], head.tilt_joint: present[1]}
        )
        if not self._enabled:
            return
        if placed is not None:
            self._tracker.target_seen(placed[1], now)
        step = self._tracker.step(present, now)
        if step.gaze is not None and not step.gaze.reached:
            self.get_logger().error(
                f"the head holds still: {step.gaze.reason}", throttle_duration_sec=2.0
            )
        self._interface.send(step.command)
        self._interface.publish_error(step.error)
        self._report_state()

    def _report_state(self) -> None:
        if self._tracker is not None and self._tracker.state is not self._state:
            self._state = self._tracker.state
            self.get_logger().info(f"{self._state}")

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._enabled = request.data
        response.success = True
        response.message = "tracking is on" if request.data else "tracking is off; the head stops"
        present = self._interface.positions()
        if not request.data and present is not None and self._tracker is not None:
            self._interface.send(self._tracker.stop(present))
        return response

    def _on_recenter(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        present = self._interface.positions() if self._interface.ready() else None
        if present is None or self._tracker is None:
            response.message = "the head cannot be recentred: there is no model or no joint state"
            return response
        self._interface.forget_targets()
        self._interface.send(self._tracker.recenter(present))
        response.success = True
        response.message = "recentring; the next target is followed again"
        return response


def main() -> int:
    """Runs the node until it is interrupted."""
    return run_node(HeadTrackerNode)


if __name__ == "__main__":
    raise SystemExit(main())
