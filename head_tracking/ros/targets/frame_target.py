"""frame_target: publish the position of a frame as the target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from head_tracking.parameters import parameter
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.spinning import steady_timer
from head_tracking.ros.kit.target_point import TargetOutput
from head_tracking.targets import FrameTarget, FrameTargetParameters, StaleFrameError
from head_tracking.tf import Buffer, listening_buffer
from head_tracking.transforms import TransformException


@dataclass(frozen=True, slots=True)
class FrameTargetRate:
    """Rate of the node."""

    rate: float = parameter(
        30.0, "Maximum rate of targets.", unit="Hz", minimum=0.1, maximum=1000.0, fixed=True
    )


class FrameTargetNode(Node):
    """Publishes `target_point` while the transform of the frame is known."""

    def __init__(self, buffer: Buffer | None = None, **options: Any) -> None:
        super().__init__("frame_target", **options)
        rate = NodeParameters(self, FrameTargetRate).value.rate
        self._target = FrameTarget(
            (buffer or listening_buffer(self)).core,
            NodeParameters(self, FrameTargetParameters, on_change=self._on_parameters).value,
        )
        self._targets = TargetOutput(self)
        steady_timer(self, 1.0 / rate, self._publish)

    def _on_parameters(self, parameters: FrameTargetParameters) -> None:
        self._target.parameters = parameters

    def _publish(self) -> None:
        if not self._targets.on:
            return
        try:
            target = self._target.newest(self.get_clock().now().nanoseconds)
        except (StaleFrameError, TransformException) as error:
            self.get_logger().warning(f"no target: {error}", throttle_duration_sec=2.0)
            return
        if target is not None:
            self._targets.publish(target)
