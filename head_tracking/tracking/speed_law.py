"""The tutorials' tracking law: speed proportional to the error, goal a lead ahead.

The goal stays `lead_target_angle` ahead of where the joint is, so the joint never gets there
and moves at the speed it is given; if the node dies the head travels no farther than the lead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from head_tracking.gaze import HeadCommand
from head_tracking.parameters import parameter
from head_tracking.transforms import JointLimits


@dataclass(frozen=True, slots=True)
class SpeedLawParameters:
    """The parameters of the law; names and defaults are the tutorials'."""

    max_joint_speed: float = parameter(
        0.5, "Fastest speed while tracking.", unit="rad/s", minimum=0.02, maximum=12.0
    )
    lead_target_angle: float = parameter(
        0.5, "How far ahead of the joint its goal is set.", unit="rad", minimum=0.02, maximum=3.0
    )
    pan_threshold: float = parameter(
        0.01, "Pan errors below this are left alone.", unit="rad", minimum=0.0, maximum=1.0
    )
    tilt_threshold: float = parameter(
        0.01, "Tilt errors below this are left alone.", unit="rad", minimum=0.0, maximum=1.0
    )
    k_pan: float = parameter(1.5, "Pan speed per error.", unit="1/s", minimum=0.1, maximum=20.0)
    k_tilt: float = parameter(1.5, "Tilt speed per error.", unit="1/s", minimum=0.1, maximum=20.0)


class SpeedLaw:
    """One step from wanted and present joint positions to a command."""

    def __init__(self, parameters: SpeedLawParameters) -> None:
        self.parameters = parameters
        self._pan = _JointLaw()
        self._tilt = _JointLaw()

    def step(
        self,
        wanted: tuple[float, float],
        present: tuple[float, float],
        limits: tuple[JointLimits, JointLimits],
    ) -> HeadCommand:
        """The command for now.

        Args:
            wanted: pan and tilt that look at the target [rad].
            present: pan and tilt as measured [rad].
            limits: of pan and of tilt.
        """
        p = self.parameters
        pan = self._pan.step(wanted[0] - present[0], present[0], p.k_pan, p.pan_threshold, p)
        tilt = self._tilt.step(wanted[1] - present[1], present[1], p.k_tilt, p.tilt_threshold, p)
        return HeadCommand(limits[0].clamp(pan[0]), limits[1].clamp(tilt[0]), pan[1], tilt[1])

    def reset(self) -> None:
        """Forgets where the joints were left alone."""
        self._pan, self._tilt = _JointLaw(), _JointLaw()


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
        parameters: SpeedLawParameters,
    ) -> tuple[float, float]:
        if abs(error) <= threshold:
            if self._stopped_at is None:
                self._stopped_at = present
            return self._stopped_at, parameters.max_joint_speed
        self._stopped_at = None
        speed = min(gain * abs(error), parameters.max_joint_speed)
        return present + math.copysign(parameters.lead_target_angle, error), speed
