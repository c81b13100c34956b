"""The base class of the tracking laws."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from head_tracking.gaze import Gaze, HeadCommand, PanTiltHead
from head_tracking.parameters import parameter
from head_tracking.tracking.estimator import TargetEstimate
from head_tracking.tracking.joint_readings import JointReading
from head_tracking.tracking.learned import LearnedValue, Learning, LearningParameters, ServoValues
from head_tracking.tracking.servo_model import ShaftModel


@dataclass(frozen=True, slots=True)
class SpeedLimits:
    """Speed limits of all laws."""

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
        "How far ahead of a moving joint its goal may be, and so how far the joint moves on "
        "without further commands.",
        unit="rad",
        minimum=0.02,
        maximum=3.0,
    )


@dataclass(frozen=True, slots=True)
class NoParameters:
    """Parameters of a law that has none."""


def inside(head: PanTiltHead, positions: tuple[float, float]) -> tuple[float, float]:
    """Return pan and tilt [rad], clamped to their limits."""
    return head.pan_limits.clamp(positions[0]), head.tilt_limits.clamp(positions[1])


class TrackingLaw(ABC):
    """Base class of the laws. Times are in seconds, on the clock of the stamps.

    Args:
        head: the head to control.
        period: time between two commands [s].
        limits: speed limits of all laws.
        parameters: parameters of this law, an instance of its class `Parameters`.
        servos: models of the servos that another law uses as well, by joint; None: its own. Not
            used by a law that estimates nothing.

    Attributes:
        Parameters: dataclass of parameters; their names differ from those of the other laws.
        description: what the law does, in a few words.
        usual_speed: highest speed [rad/s] unless `limits` sets one.
        limits: may change at any time.
        parameters: may change at any time.
        at_most: temporary speed limit [rad/s].
        servos: models of pan and tilt servo, by joint; empty: this law estimates nothing.
    """

    Parameters: ClassVar[type[Any]] = NoParameters
    description: ClassVar[str]
    usual_speed: ClassVar[float] = 5.0
    parameters: Any
    servos: Mapping[str, ShaftModel] = {}
    at_most = math.inf

    def __init__(
        self,
        head: PanTiltHead,
        period: float,
        limits: SpeedLimits | None = None,
        parameters: Any = None,
        servos: Mapping[str, ShaftModel] | None = None,
    ) -> None:
        self.limits = limits or SpeedLimits()
        self.parameters = parameters or self.Parameters()
        self._head = head
        self._period = period
        self._forget()

    @property
    def fastest(self) -> float:
        """The highest speed allowed now [rad/s]."""
        return min(self.limits.max_joint_speed or self.usual_speed, self.at_most)

    @property
    def delays(self) -> tuple[float, float]:
        """Delays from a command to the motion it causes, of pan and tilt [s]."""
        pan, tilt = [servo.delay for servo in self.servos.values()] or (0.0, 0.0)
        return pan, tilt

    @property
    def lead_times(self) -> tuple[float, float]:
        """Prediction times from a command on, for pan and tilt [s]."""
        pan, tilt = [servo.delay + self._period for servo in self.servos.values()] or (0.0, 0.0)
        return pan, tilt

    @property
    def learned(self) -> Mapping[str, LearnedValue]:
        """Estimates of the servos, by name."""
        return {
            f"{name}: {what}": value
            for name, servo in self.servos.items()
            for what, value in servo.values.items()
        }

    @property
    def to_save(self) -> Mapping[str, ServoValues]:
        """Estimates of the servos to save for the next run, by joint."""
        values = {name: servo.to_save for name, servo in self.servos.items()}
        return {name: value for name, value in values.items() if value is not None}

    def learn(self, parameters: LearningParameters) -> None:
        """Update, freeze, discard or replace the estimates of the servos."""
        for servo in self.servos.values():
            servo.parameters = parameters
            if parameters.servo_learning == Learning.FORGET:
                servo.forget()
                self._forget()

    def expect(self, saved: Mapping[str, ServoValues]) -> None:
        """Start with saved estimates of the servos, by joint."""
        for name, servo in self.servos.items():
            servo.expect(saved.get(name))

    @abstractmethod
    def follow(
        self, target: TargetEstimate, joints: JointReading, now: float
    ) -> tuple[HeadCommand, Gaze]:
        """Return the command that keeps the head on a target, and the gaze it aims at."""

    @abstractmethod
    def go_to(
        self, goal: tuple[float, float], speed: float, joints: JointReading, now: float
    ) -> HeadCommand:
        """Return the command to go to pan and tilt [rad] at up to `speed` [rad/s]."""

    def stop(self, joints: JointReading) -> HeadCommand:
        """Return the command that stops the head: the goal is the measured position."""
        self._forget()
        return HeadCommand(*inside(self._head, joints.positions), self.fastest, self.fastest)

    def _forget(self) -> None:  # noqa: B027 - some laws have no state
        """Discard the state of the present motion."""
