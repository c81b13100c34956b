"""The parameters of the tracking laws."""

from __future__ import annotations

from dataclasses import dataclass, field

from head_tracking.parameters import parameter


@dataclass(frozen=True, slots=True)
class SpeedLimits:
    """What all laws have in common.

    The tutorials' `max_joint_speed` is 0.5 rad/s; the other laws need no such restraint.
    """

    max_joint_speed: float = parameter(
        0.0,
        "Fastest speed while tracking; 0: 0.5 rad/s with the law `speed` (the tutorials' value), "
        "5 rad/s with the others.",
        unit="rad/s",
        minimum=0.0,
        maximum=12.0,
    )
    lead_target_angle: float = parameter(
        0.5,
        "How far ahead of a moving joint its goal may be: so far it moves on if nobody speaks "
        "any more.",
        unit="rad",
        minimum=0.02,
        maximum=3.0,
    )

    def speed(self, usual: float) -> float:
        """The fastest speed for a law that usually needs `usual` [rad/s]."""
        return self.max_joint_speed or usual


@dataclass(frozen=True, slots=True)
class SpeedLawParameters:
    """Names and defaults are the tutorials'; see `SpeedLimits` for the other two."""

    pan_threshold: float = parameter(
        0.01, "Pan errors below this are left alone.", unit="rad", minimum=0.0, maximum=1.0
    )
    tilt_threshold: float = parameter(
        0.01, "Tilt errors below this are left alone.", unit="rad", minimum=0.0, maximum=1.0
    )
    k_pan: float = parameter(1.5, "Pan speed per error.", unit="1/s", minimum=0.1, maximum=20.0)
    k_tilt: float = parameter(1.5, "Tilt speed per error.", unit="1/s", minimum=0.1, maximum=20.0)


@dataclass(frozen=True, slots=True)
class PredictiveLawParameters:
    """How calmly the head moves."""

    max_joint_acceleration: float = parameter(
        50.0, "Hardest acceleration.", unit="rad/s^2", minimum=1.0, maximum=500.0
    )
    max_joint_jerk: float = parameter(
        3000.0, "Hardest change of acceleration.", unit="rad/s^3", minimum=10.0, maximum=1e5
    )
    dead_band: float = parameter(
        0.004,
        "At rest, errors below this are left alone.",
        unit="rad",
        minimum=0.0,
        maximum=0.1,
    )
    servo_delay: float = parameter(
        0.0,
        "From a command to the motion it causes; 0: measured while the head moves.",
        unit="s",
        minimum=0.0,
        maximum=0.15,
    )


@dataclass(frozen=True, slots=True)
class LawParameters:
    """Those of all laws; each law takes what it needs.

    Attributes:
        limits: of all.
        speed: of the law `speed`.
        predictive: of the law `predictive`.
    """

    limits: SpeedLimits = field(default_factory=SpeedLimits)
    speed: SpeedLawParameters = field(default_factory=SpeedLawParameters)
    predictive: PredictiveLawParameters = field(default_factory=PredictiveLawParameters)
