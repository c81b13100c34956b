"""point_head: turns the head to a point and says whether it got there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from rclpy.node import Node

from head_tracking.control import STOPPED, ControlLoop
from head_tracking.gaze import HeadCommand, PanTiltHead, Pointing, PointingParameters
from head_tracking.parameters import parameter
from head_tracking.ros.head_actions import HeadActions
from head_tracking.ros.head_interface import HeadInterface, HeadReading
from head_tracking.ros.parameters import NodeParameters
from head_tracking.ros.spinning import run_node
from head_tracking.tf import Buffer
from head_tracking.tracking import CAUTIOUS_SPEED, HeadBase, Refusal


@dataclass(frozen=True, slots=True)
class PointHeadParameters:
    """What to point."""

    pointing_frame: str = parameter("camera_link", "The frame to point.", fixed=True)
    controller_name: str = parameter(
        "",
        "Below this name clients find the actions and joint_trajectory: head_controller for those "
        "of TIAGo, head_traj_controller for PR2's. Empty: below the node's own.",
        fixed=True,
    )


class PointHeadNode(Node):
    """Points a frame of the head at `target_point`, or as the goals of actions have it.

    As long as a goal is under way, points on `target_point` are left alone.

    Args:
        buffer: the transforms that the process shares; None: this node listens itself.
        loop: that of the process; None: this node runs it.
    """

    what = "pointing"

    def __init__(
        self, buffer: Buffer | None = None, loop: ControlLoop | None = None, **options: Any
    ) -> None:
        super().__init__("point_head", **options)
        p = NodeParameters(self, PointHeadParameters).value
        self._pointing_parameters = NodeParameters(
            self, PointingParameters, on_change=self._on_parameters
        )
        self._pointing: Pointing | None = None
        self._outcome = "no target has come yet"
        self.interface = HeadInterface(
            self, p.pointing_frame, "~/pointing_error", buffer, loop, self
        )
        self.actions = HeadActions(
            self, p.controller_name or "~", self.interface, lambda: self._tuned, self._said
        )
        self.interface.begin()

    def destroy_node(self) -> None:
        """Ends its part in the loop."""
        self.interface.close()
        super().destroy_node()

    @property
    def failure(self) -> Exception | None:
        """What has ended its part in the loop."""
        return self.interface.failure

    def reset(self, reason: str) -> None:
        """What is known of the turn that is under way holds no more; the head ends it by itself."""
        self.actions.end(reason)
        self._forget()

    def _forget(self) -> None:
        """Whatever comes next begins where the head is."""
        if self._pointing is not None:
            self._pointing = Pointing(self._pointing.head, self._tuned)

    def head_known(self, head: PanTiltHead, base: HeadBase | None) -> None:
        """See `HeadTurner`."""
        self._pointing = Pointing(head, self._tuned)
        self.actions.head_known(head)
        self.get_logger().info(f"ready to point {head.pointing_frame} at target_point")

    @property
    def _tuned(self) -> PointingParameters:
        p = self._pointing_parameters.value
        if self.interface.slow:
            p = replace(p, max_velocity=min(p.max_velocity, CAUTIOUS_SPEED))
        return p

    def _on_parameters(self, _: PointingParameters) -> None:
        self._tune()

    def _tune(self) -> None:
        if self._pointing is not None:
            self._pointing.parameters = self._tuned

    def recenter(self, reading: HeadReading) -> str:
        """See `HeadTurner`."""
        assert self._pointing is not None
        self.actions.end("the head is recentred")
        self._said("recentring")
        self.interface.send(self._pointing.recenter(reading.positions, reading.now))
        return "recentring"

    def switched(self) -> None:
        """See `HeadTurner`."""
        self.actions.end(self.interface.off or STOPPED)
        self._forget()

    def _said(self, outcome: str) -> None:
        """Keeps what the state says."""
        self._outcome = outcome

    def report(self) -> None:
        """See `HeadTurner`."""
        self.actions.tell()
        if self.interface.off:
            state, text = "disabled", f"disabled: {self.interface.off}"
        elif self.interface.trouble:
            state, text = "idle", f"idle: {self.interface.trouble}"
        elif self.actions.task is not None:
            state, text = "turning", self.actions.task.title
        else:
            turning = self._pointing is not None and self._pointing.turning
            state, text = "turning" if turning else "holding", self._outcome
        self.interface.publish_state(state, text)

    def halt(self, reading: HeadReading | None) -> HeadCommand | None:
        """See `HeadTurner`."""
        if self._pointing is None or reading is None:
            return None
        halted = self.actions.halt(reading)
        return halted or self._pointing.stop(reading.positions, reading.now)

    def step(self, reading: HeadReading) -> HeadCommand | None:
        """See `HeadTurner`."""
        pointing = self._pointing
        if pointing is None:
            return None
        if self.interface.off:
            self.actions.end(self.interface.off)
        task = self.actions.task
        if task is not None:
            self._forget()
            self.interface.forget_targets()
            command = self.actions.step(reading)
            self.interface.tell_error(task.miss)
            return command
        command = self._take_target(pointing, reading)
        if self.interface.off:
            return None
        self.interface.tell_error(pointing.miss(reading.positions))
        result = pointing.judge(reading.positions, reading.now)
        if result is not None:
            self._said(str(result))
            if result.arrived:
                self.interface.slow = False
                self._tune()
                self.get_logger().info(str(result))
            else:
                self.get_logger().warning(str(result))
        return command

    def _take_target(self, pointing: Pointing, reading: HeadReading) -> HeadCommand | None:
        start = pointing.start_from(reading.positions)
        placed = self.interface.take_newest_target(start, reading.now)
        self.interface.take_refusal()
        if placed is None or self.interface.off:
            return None
        target, point = placed
        gaze, command = pointing.point_at(point, reading.positions, reading.now)
        if pointing.turning:
            self._said(f"turning to {target}")
        if command is None:
            self._said(f"refused: {gaze.reason}")
            self.interface.refuse(Refusal(target, f"nothing moves: {gaze.reason}"))
        elif not gaze.reached:
            self.get_logger().warning(f"target {target}: {gaze.reason}", throttle_duration_sec=1.0)
        return command


def main() -> int:
    """Runs the node until it is interrupted."""
    return run_node(PointHeadNode)


if __name__ == "__main__":
    raise SystemExit(main())
