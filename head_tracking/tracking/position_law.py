"""Aim and go: the goal is where the target is, and the servo runs there as fast as it may."""

from __future__ import annotations

from head_tracking.gaze import Gaze, HeadCommand, PanTiltHead, together
from head_tracking.tracking.estimator import TargetEstimate
from head_tracking.tracking.law import JointReading, inside
from head_tracking.tracking.law_parameters import LawParameters

USUAL_SPEED = 5.0  # rad/s


class PositionLaw:
    """Both joints go to the newest point and arrive together; it knows nothing of motion.

    If the node dies, the head still goes where the target last was.

    Attributes:
        parameters: may change at any time.
    """

    horizon = 0.0
    delays = (0.0, 0.0)

    def __init__(self, head: PanTiltHead, period: float, parameters: LawParameters) -> None:
        self.parameters = parameters
        self._head = head

    def follow(
        self, target: TargetEstimate, joints: JointReading, now: float
    ) -> tuple[HeadCommand, Gaze]:
        """See `TrackingLaw`."""
        gaze = self._head.look(target.sight, *joints.positions)
        goal = gaze.pan, gaze.tilt
        return together(joints.positions, goal, self.parameters.limits.speed(USUAL_SPEED)), gaze

    def go_to(
        self, goal: tuple[float, float], speed: float, joints: JointReading, now: float
    ) -> HeadCommand:
        """See `TrackingLaw`."""
        return together(joints.positions, goal, speed)

    def stop(self, joints: JointReading, now: float) -> HeadCommand:
        """See `TrackingLaw`."""
        goal = inside(self._head, joints.positions)
        return together(goal, goal, self.parameters.limits.speed(USUAL_SPEED))
