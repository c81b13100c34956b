"""The tutorials' tracking law: speed proportional to the error, goal a lead ahead.

The goal stays `lead_target_angle` ahead of where the joint is, so the joint never gets there
and moves at the speed it is given; if the node dies the head travels no farther than the lead.
"""

from __future__ import annotations

import math

from head_tracking.gaze import Gaze, GazeStatus, HeadCommand, PanTiltHead
from head_tracking.tracking.estimator import TargetEstimate
from head_tracking.tracking.law import JointReading, inside
from head_tracking.tracking.law_parameters import LawParameters

USUAL_SPEED = 0.5  # rad/s, the tutorials'


class SpeedLaw:
    """Speeds in proportion to the errors of pan and tilt.

    Attributes:
        parameters: may change at any time.
    """

    horizon = 0.0
    delays = (0.0, 0.0)

    def __init__(self, head: PanTiltHead, period: float, parameters: LawParameters) -> None:
        self.parameters = parameters
        self._head = head
        self._joints = _JointLaw(), _JointLaw()
        self._held: tuple[float, float] | None = None

    def follow(
        self, target: TargetEstimate, joints: JointReading, now: float
    ) -> tuple[HeadCommand, Gaze]:
        """See `TrackingLaw`; it knows no motion of the target and aims at the newest point."""
        gaze = self._head.look(target.sight, *joints.positions)
        if gaze.status in (GazeStatus.REACHED, GazeStatus.ON_PAN_AXIS):
            self._held = None
            return self.step((gaze.pan, gaze.tilt), joints.positions), gaze
        held = self._held or inside(self._head, joints.positions)
        self._forget()
        self._held = held
        return self._at_usual_speed(held), gaze

    def go_to(
        self, goal: tuple[float, float], speed: float, joints: JointReading, now: float
    ) -> HeadCommand:
        """See `TrackingLaw`."""
        self._forget()
        return HeadCommand(*goal, speed, speed)

    def stop(self, joints: JointReading, now: float) -> HeadCommand:
        """See `TrackingLaw`."""
        self._forget()
        return self._at_usual_speed(inside(self._head, joints.positions))

    def step(self, wanted: tuple[float, float], present: tuple[float, float]) -> HeadCommand:
        """The command for now.

        Args:
            wanted: pan and tilt that look at the target [rad].
            present: pan and tilt as measured [rad].
        """
        p, limits = self.parameters.speed, self.parameters.limits
        fastest, lead = limits.speed(USUAL_SPEED), limits.lead_target_angle
        (pan, pan_speed), (tilt, tilt_speed) = (
            joint.step(there - here, here, gain, threshold, fastest, lead)
            for joint, there, here, gain, threshold in zip(
                self._joints,
                wanted,
                present,
                (p.k_pan, p.k_tilt),
                (p.pan_threshold, p.tilt_threshold),
                strict=True,
            )
        )
        head = self._head
        return HeadCommand(
            head.pan_limits.clamp(pan), head.tilt_limits.clamp(tilt), pan_speed, tilt_speed
        )

    def _at_usual_speed(self, goal: tuple[float, float]) -> HeadCommand:
        speed = self.parameters.limits.speed(USUAL_SPEED)
        return HeadCommand(*goal, speed, speed)

    def _forget(self) -> None:
        self._joints, self._held = (_JointLaw(), _JointLaw()), None


class _JointLaw:
    """The law for one joint; where it stopped stays its goal, or it would follow its own sag."""

    def __init__(self) -> None:
        self._stopped_at: float | None = None

    def step(
        self,
        error: float,
        present: float,
        gain: float,
        threshold: float,
        fastest: float,
        lead: float,
    ) -> tuple[float, float]:
        if abs(error) <= threshold:
            if self._stopped_at is None:
                self._stopped_at = present
            return self._stopped_at, fastest
        self._stopped_at = None
        speed = min(gain * abs(error), fastest)
        return present + math.copysign(lead, error), speed
