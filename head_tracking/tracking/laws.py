"""Tracking laws: each turns a target estimate into commands for the joints.

`position` goes to the latest point, `speed` is the law of the tutorials, and `predictive` feeds
the predicted motion of the target forward.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeAlias

from head_tracking.gaze import Gaze, GazeStatus, HeadCommand, PanTiltHead, together
from head_tracking.parameters import parameter
from head_tracking.tracking.estimator import TargetEstimate
from head_tracking.tracking.joint_controller import (
    RESERVE,
    JointController,
    MotionLimits,
    Reference,
)
from head_tracking.tracking.joint_readings import JointReading
from head_tracking.tracking.learned import LearnedValue, ServoValues
from head_tracking.tracking.servo_model import ServoModel


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
class SpeedLawParameters:
    """Names and defaults are the tutorials'; see `SpeedLimits` for the other two."""

    pan_threshold: float = parameter(
        0.01, "Smaller pan errors are not corrected.", unit="rad", minimum=0.0, maximum=1.0
    )
    tilt_threshold: float = parameter(
        0.01, "Smaller tilt errors are not corrected.", unit="rad", minimum=0.0, maximum=1.0
    )
    k_pan: float = parameter(1.5, "Pan speed per error.", unit="1/s", minimum=0.1, maximum=20.0)
    k_tilt: float = parameter(1.5, "Tilt speed per error.", unit="1/s", minimum=0.1, maximum=20.0)


@dataclass(frozen=True, slots=True)
class PredictiveLawParameters:
    """Limits and dead band of the law `predictive`."""

    max_joint_acceleration: float = parameter(
        80.0, "Highest acceleration.", unit="rad/s^2", minimum=1.0, maximum=500.0
    )
    max_joint_jerk: float = parameter(
        6000.0, "Highest jerk.", unit="rad/s^3", minimum=10.0, maximum=1e5
    )
    dead_band: float = parameter(
        0.004,
        "At rest, smaller errors are not corrected.",
        unit="rad",
        minimum=0.0,
        maximum=0.1,
    )
    servo_delay: float = parameter(
        0.0,
        "Time from a command to the motion it causes; 0: estimated while the head moves.",
        unit="s",
        minimum=0.0,
        maximum=0.15,
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

    Attributes:
        Parameters: dataclass of parameters; their names differ from those of the other laws.
        description: what the law does, in a few words.
        usual_speed: highest speed [rad/s] unless `limits` sets one.
        limits: may change at any time.
        parameters: may change at any time.
        at_most: temporary speed limit [rad/s].
        is_learning: whether the servo models are updated.
    """

    Parameters: ClassVar[type[Any]] = NoParameters
    description: ClassVar[str]
    usual_speed: ClassVar[float] = 5.0
    parameters: Any
    at_most = math.inf
    is_learning = True

    def __init__(
        self,
        head: PanTiltHead,
        period: float,
        limits: SpeedLimits | None = None,
        parameters: Any = None,
    ) -> None:
        self.limits = limits or SpeedLimits()
        self.parameters = parameters or self.Parameters()
        self._head = head
        self._period = period

    @property
    def fastest(self) -> float:
        """The highest speed allowed now [rad/s]."""
        return min(self.limits.max_joint_speed or self.usual_speed, self.at_most)

    @property
    def delays(self) -> tuple[float, float]:
        """Delays from a command to the motion it causes, of pan and tilt [s]."""
        return 0.0, 0.0

    @property
    def learned(self) -> Mapping[str, LearnedValue]:
        """Estimates of the servos, by name."""
        return {}

    @property
    def to_save(self) -> Mapping[str, ServoValues]:
        """Estimates of the servos to save for the next run, by joint."""
        return {}

    def forget_learned(self) -> None:  # noqa: B027 - some laws learn nothing
        """Discard the estimates of the servos."""

    def expect(self, saved: Mapping[str, ServoValues]) -> None:  # noqa: B027
        """Start with saved estimates of the servos, by joint."""

    def take_contradicted(self) -> Sequence[str]:
        """Return joints whose saved values were contradicted since the last call."""
        return ()

    @property
    def lead_times(self) -> tuple[float, float]:
        """Prediction times from a command on, for pan and tilt [s]."""
        return 0.0, 0.0

    @property
    def horizon(self) -> float:
        """The mean of `lead_times` [s]."""
        return 0.5 * sum(self.lead_times)

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


class PositionLaw(TrackingLaw):
    """Send both joints to the latest point; they arrive together."""

    description = "straight to the latest point"

    def follow(
        self, target: TargetEstimate, joints: JointReading, now: float
    ) -> tuple[HeadCommand, Gaze]:
        """See `TrackingLaw`."""
        gaze = self._head.look(target.sight, *joints.positions)
        goal = gaze.pan, gaze.tilt
        return together(joints.positions, goal, self.fastest), gaze

    def go_to(
        self, goal: tuple[float, float], speed: float, joints: JointReading, now: float
    ) -> HeadCommand:
        """See `TrackingLaw`."""
        return together(joints.positions, goal, speed)


class SpeedLaw(TrackingLaw):
    """Set speeds in proportion to the errors of pan and tilt."""

    Parameters = SpeedLawParameters
    description = "by the tutorials' speeds"
    usual_speed = 0.5
    parameters: SpeedLawParameters

    def __init__(
        self,
        head: PanTiltHead,
        period: float,
        limits: SpeedLimits | None = None,
        parameters: SpeedLawParameters | None = None,
    ) -> None:
        super().__init__(head, period, limits, parameters)
        self._joints = _JointLaw(), _JointLaw()
        self._held: tuple[float, float] | None = None

    def follow(
        self, target: TargetEstimate, joints: JointReading, now: float
    ) -> tuple[HeadCommand, Gaze]:
        """See `TrackingLaw`."""
        gaze = self._head.look(target.sight, *joints.positions)
        if gaze.status in (GazeStatus.REACHED, GazeStatus.ON_PAN_AXIS):
            self._held = None
            return self.step((gaze.pan, gaze.tilt), joints.positions), gaze
        held = self._held or inside(self._head, joints.positions)
        self._forget()
        self._held = held
        return HeadCommand(*held, self.fastest, self.fastest), gaze

    def go_to(
        self, goal: tuple[float, float], speed: float, joints: JointReading, now: float
    ) -> HeadCommand:
        """See `TrackingLaw`."""
        self._forget()
        return HeadCommand(*goal, speed, speed)

    def step(self, wanted: tuple[float, float], present: tuple[float, float]) -> HeadCommand:
        """Return the command for now.

        Args:
            wanted: pan and tilt that look at the target [rad].
            present: measured pan and tilt [rad].
        """
        p, fastest, lead = self.parameters, self.fastest, self.limits.lead_target_angle
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

    def _forget(self) -> None:
        self._joints, self._held = (_JointLaw(), _JointLaw()), None


class _JointLaw:
    """The law for one joint; at rest its goal stays, so that it does not follow its sag."""

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


_LONGEST_PAUSE = 0.2  # s; after a longer pause the law starts anew
_SHORTEST = 1e-4  # s between two commands; simulated clocks may stop
_BUILD_UP = 0.02  # s; an acceleration that takes longer to build up is not planned
_MOVING = 0.15  # rad/s
_EDGE = 0.05  # rad; a target at the other end of the pan range is followed if this far inside
_ALIKE = 0.003  # s; delays that differ by less are treated as equal

Path: TypeAlias = Callable[[float], tuple[float, float]]
"""Reference of pan and tilt [rad] at a time [s]."""


class PredictiveLaw(TrackingLaw):
    """Feed the motion of the target forward through the exact gaze.

    For each joint: the reference is the gaze at the target, predicted by the servo's delay;
    `JointMotion` plans the motion to it within the limits; `ServoModel` has the set-point, and so
    the speed to command. The goal lies ahead, but not beyond the next positions of the reference.
    """

    Parameters = PredictiveLawParameters
    description = "with the target's predicted motion"
    parameters: PredictiveLawParameters

    def __init__(
        self,
        head: PanTiltHead,
        period: float,
        limits: SpeedLimits | None = None,
        parameters: PredictiveLawParameters | None = None,
    ) -> None:
        super().__init__(head, period, limits, parameters)
        self._joints = (
            JointController(head.pan_joint, head.pan_limits),
            JointController(head.tilt_joint, head.tilt_limits),
        )
        self._stepped = -math.inf
        self._aimed: tuple[float, float] | None = None
        self._expected: frozenset[str] = frozenset()  # joints whose saved values are used

    @property
    def delays(self) -> tuple[float, float]:
        """See `TrackingLaw`."""
        pan, tilt = self._joints
        return pan.servo.delay, tilt.servo.delay

    @property
    def learned(self) -> Mapping[str, LearnedValue]:
        """See `TrackingLaw`."""
        return {
            f"{name}: {what}": value
            for name, servo in self._servos.items()
            for what, value in servo.values.items()
        }

    @property
    def to_save(self) -> Mapping[str, ServoValues]:
        """See `TrackingLaw`."""
        values = {name: servo.to_save for name, servo in self._servos.items()}
        return {name: value for name, value in values.items() if value is not None}

    def expect(self, saved: Mapping[str, ServoValues]) -> None:
        """See `TrackingLaw`."""
        for name, servo in self._servos.items():
            servo.expect(saved.get(name))
        self._expected = frozenset(saved)

    def take_contradicted(self) -> Sequence[str]:
        """See `TrackingLaw`."""
        servos = self._servos
        found = [name for name in self._expected if servos[name].saved is None]
        self._expected -= set(found)
        return found

    @property
    def _servos(self) -> Mapping[str, ServoModel]:
        names = self._head.pan_joint, self._head.tilt_joint
        return {name: joint.servo for name, joint in zip(names, self._joints, strict=True)}

    def forget_learned(self) -> None:
        """See `TrackingLaw`."""
        self._stepped, self._expected = -math.inf, frozenset()
        for joint in self._joints:
            joint.forget()

    @property
    def lead_times(self) -> tuple[float, float]:
        """See `TrackingLaw`."""
        pan, tilt = self.delays
        return pan + self._period, tilt + self._period

    def follow(
        self, target: TargetEstimate, joints: JointReading, now: float
    ) -> tuple[HeadCommand, Gaze]:
        """See `TrackingLaw`."""
        elapsed = self._receive(joints, now)
        pan, tilt = self._joints
        near = pan.motion.position, tilt.motion.position

        def path(time: float) -> tuple[float, float]:
            gaze = self._gaze(target, time, near)
            return gaze.pan, gaze.tilt

        deviations = [
            (target.deviation(joint, now + lead), target.speed_deviation(joint))
            for joint, lead in enumerate(self.lead_times)
        ]
        command = self._along(path, self.fastest, elapsed, now, deviations)
        gaze = self._gaze(target, now + self.horizon, near)
        self._aimed = gaze.pan, gaze.tilt
        return command, gaze

    def go_to(
        self, goal: tuple[float, float], speed: float, joints: JointReading, now: float
    ) -> HeadCommand:
        """See `TrackingLaw`."""
        return self.along(lambda time: goal, speed, joints, now)

    def along(self, path: Path, speed: float, joints: JointReading, now: float) -> HeadCommand:
        """Return the command that keeps the joints on a path.

        Args:
            path: reference of pan and tilt.
            speed: speed limit [rad/s].
            joints: the latest reading.
            now: the time [s].
        """
        elapsed = self._receive(joints, now)
        self._aimed = None
        return self._along(path, speed, elapsed, now)

    def _forget(self) -> None:
        self._stepped, self._aimed = -math.inf, None

    def _receive(self, joints: JointReading, now: float) -> float:
        """Pass the reading to both joints; restart them after a pause.

        Returns the time since the last command [s].
        """
        elapsed = now - self._stepped
        self._stepped = now
        anew = not 0.0 <= elapsed <= max(_LONGEST_PAUSE, 3.0 * self._period)
        elapsed = max(elapsed, _SHORTEST)
        if anew:
            self._aimed, elapsed = None, self._period
        for joint, position, velocity in zip(
            self._joints, joints.positions, joints.velocities, strict=True
        ):
            joint.servo.known_delay = self.parameters.servo_delay
            joint.servo.is_learning = self.is_learning
            if anew:
                joint.restart(joints.stamp, position, velocity)
            else:
                joint.measured(joints.stamp, position, elapsed)
        return elapsed

    def _gaze(self, target: TargetEstimate, time: float, near: tuple[float, float]) -> Gaze:
        """Return the gaze at the predicted target.

        The head does not turn all the way round to a target that has just come into reach at the
        other end of the pan range.
        """
        gaze = self._head.look(target.sight_at(time), *near)
        if self._aimed is None:
            return gaze
        pan, tilt = self._aimed
        limits = self._head.pan_limits
        inside = min(limits.upper - gaze.pan, gaze.pan - limits.lower)
        if abs(gaze.pan - pan) < math.pi or inside > _EDGE:
            return gaze
        reason = f"the target has just come into reach at the other end, at pan {gaze.pan:.2f} rad"
        return replace(gaze, pan=pan, tilt=tilt, status=GazeStatus.OUT_OF_REACH, reason=reason)

    def _along(
        self,
        path: Path,
        speed: float,
        elapsed: float,
        now: float,
        deviations: Sequence[tuple[float, float]] = ((0.0, 0.0), (0.0, 0.0)),
    ) -> HeadCommand:
        """Return the command for both joints, each with its own delay."""
        starts = [now + delay for delay in self.delays]
        if abs(starts[1] - starts[0]) < _ALIKE:
            starts[1] = starts[0]
        ahead = (0.0, self._period, self._period + RESERVE)
        places = {start: [path(start + time) for time in ahead] for start in set(starts)}
        references = []
        for index, start in enumerate(starts):
            here, soon, last = (place[index] for place in places[start])
            references.append((here, (soon - here) / self._period, (soon, last)))
        moving = max(abs(velocity) for _, velocity, _ in references) > _MOVING
        p = self.parameters
        acceleration = min(p.max_joint_acceleration, _BUILD_UP * p.max_joint_jerk)
        goals = []
        for joint, (position, velocity, later), (noise, speed_noise), limits in zip(
            self._joints,
            references,
            deviations,
            (self._head.pan_limits, self._head.tilt_limits),
            strict=True,
        ):
            # while one joint moves, the other does not rest either
            spread = (0.0, 0.0) if moving else (noise, speed_noise)
            goals.append(
                joint.follow(
                    Reference(position, velocity, *spread, later),
                    now,
                    self._period,
                    elapsed,
                    MotionLimits(
                        min(speed, limits.velocity),
                        acceleration,
                        p.max_joint_jerk,
                        self.limits.lead_target_angle,
                    ),
                    p.dead_band,
                )
            )
        (pan, pan_speed), (tilt, tilt_speed) = goals
        return HeadCommand(pan, tilt, pan_speed, tilt_speed)


LAWS: Mapping[str, type[TrackingLaw]] = {
    "predictive": PredictiveLaw,
    "speed": SpeedLaw,
    "position": PositionLaw,
}
"""The laws by name; `head_tracker` declares the parameters of each."""
