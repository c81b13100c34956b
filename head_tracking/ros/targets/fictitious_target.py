"""fictitious_target: publishes the tutorial's moving point, or any point, as the target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from rclpy.time import Time

from head_tracking.parameters import parameter
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.spinning import steady_timer
from head_tracking.ros.kit.target_point import TargetOutput
from head_tracking.tracking import FictitiousTarget, FictitiousTargetParameters, Target


@dataclass(frozen=True, slots=True)
class TargetFrameParameters:
    """Frame and rate of the target."""

    frame_id: str = parameter("base_link", "Frame of the target.", fixed=True)
    rate: float = parameter(
        40.0, "Targets per second.", unit="Hz", minimum=0.1, maximum=1000.0, fixed=True
    )


class FictitiousTargetNode(Node):
    """Publishes `target_point`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("fictitious_target", **options)
        p = NodeParameters(self, TargetFrameParameters).value
        self._frame_id, self._rate = p.frame_id, p.rate
        self._target = FictitiousTarget(
            NodeParameters(self, FictitiousTargetParameters, on_change=self._on_parameters).value
        )
        self._targets = TargetOutput(self)
        self._sent: Time | None = None
        steady_timer(self, 1.0 / p.rate, self._publish)

    def _on_parameters(self, parameters: FictitiousTargetParameters) -> None:
        self._target.parameters = parameters

    def _publish(self) -> None:
        now = self.get_clock().now()
        if not self._targets.on or now == self._sent:
            return  # simulated time is paused
        elapsed = (now - self._sent).nanoseconds * 1e-9 if self._sent is not None else 0.0
        self._sent = now
        target = Target(now.nanoseconds, self._frame_id, self._target.advance(elapsed * self._rate))
        self._targets.publish(target)
