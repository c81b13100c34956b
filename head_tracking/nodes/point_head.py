"""point_head: turns the head to a point and says whether it got there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from head_tracking.gaze import PanTiltHead, Pointing, PointingParameters
from head_tracking.parameters import parameter
from head_tracking.ros.head_interface import HeadInterface, HeadReading
from head_tracking.ros.parameters import NodeParameters
from head_tracking.ros.spinning import run_node, steady_timer
from head_tracking.tf import Buffer
from head_tracking.tf.qos import LATCHED
from head_tracking.tracking import HeadBase, Refusal


@dataclass(frozen=True, slots=True)
class PointHeadParameters:
    """What to point."""

    pointing_frame: str = parameter("camera_link", "The frame to point.", fixed=True)
    rate: float = parameter(
        20.0, "How often the error is published.", unit="Hz", minimum=1.0, maximum=200.0, fixed=True
    )


class PointHeadNode(Node):
    """Points a frame of the head at `target_point`."""

    def __init__(self, buffer: Buffer | None = None, **options: Any) -> None:
        super().__init__("point_head", **options)
        p = NodeParameters(self, PointHeadParameters).value
        self._pointing_parameters = NodeParameters(
            self, PointingParameters, on_change=self._on_parameters
        )
        self._pointing: Pointing | None = None
        self._interface = HeadInterface(
            self,
            p.pointing_frame,
            "~/pointing_error",
            buffer,
            self._on_head,
            self._reset,
            self._step,
        )
        self._enabled = True
        self._says_enabled = self.create_publisher(Bool, "~/enabled", LATCHED)
        self._says_enabled.publish(Bool(data=True))
        self.create_service(SetBool, "~/enable", self._on_enable)
        self.create_service(Trigger, "~/recenter", self._on_recenter)
        steady_timer(self, 1.0 / p.rate, self._step)

    @property
    def head(self) -> PanTiltHead | None:
        """The head that is turned, once the robot's model is known."""
        return None if self._pointing is None else self._pointing.head

    def _reset(self, _: str) -> None:
        """What is known of the turn that is under way holds no more; the head ends it by itself."""
        if self._pointing is not None:
            self._pointing = Pointing(self._pointing.head, self._pointing_parameters.value)

    def _on_head(self, head: PanTiltHead, _: HeadBase | None) -> None:
        self._pointing = Pointing(head, self._pointing_parameters.value)
        self.get_logger().info(f"ready to point {head.pointing_frame} at target_point")

    def _on_parameters(self, parameters: PointingParameters) -> None:
        if self._pointing is not None:
            self._pointing.parameters = parameters

    def _step(self) -> None:
        reading = self._interface.reading()
        if reading is None or self._pointing is None:
            return
        present = reading.positions
        self._take_target(self._pointing, reading)
        if not self._enabled:
            return
        self._interface.publish_error(self._pointing.miss(present))
        result = self._pointing.judge(present, reading.now)
        if result is not None:
            if result.arrived:
                self.get_logger().info(str(result))
            else:
                self.get_logger().warning(str(result))

    def _take_target(self, pointing: Pointing, reading: HeadReading) -> None:
        start = pointing.start_from(reading.positions)
        placed = self._interface.take_newest_target(start, reading.now)
        self._interface.take_refusal()
        if placed is None or not self._enabled:
            return
        target, point = placed
        gaze, command = pointing.point_at(point, reading.positions, reading.now)
        if command is None:
            self._interface.refuse(Refusal(target, f"nothing moves: {gaze.reason}"))
        elif not gaze.reached:
            self.get_logger().warning(f"target {target}: {gaze.reason}", throttle_duration_sec=1.0)
        self._interface.send(command)

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._enabled = request.data
        self._says_enabled.publish(Bool(data=request.data))
        response.success = True
        response.message = f"pointing is {'on' if request.data else 'off; targets are not taken'}"
        return response

    def _on_recenter(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        reading = self._interface.reading()
        if reading is None or self._pointing is None:
            response.message = "the head cannot be recentred: there is no model or no joint state"
            return response
        self._interface.forget_targets()
        self._interface.send(self._pointing.recenter(reading.positions, reading.now))
        response.success, response.message = True, "recentring"
        return response


def main() -> int:
    """Runs the node until it is interrupted."""
    return run_node(PointHeadNode)


if __name__ == "__main__":
    raise SystemExit(main())
