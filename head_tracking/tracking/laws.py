"""Tracking laws: each turns a target estimate into commands for the joints.

`position` goes to the latest point, `speed` is the law of the tutorials, and `predictive` feeds
the predicted motion of the target forward.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

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
from head_tracking.tracking.law import SpeedLimits, TrackingLaw, inside
from head_tracking.tracking.servo_model import ShaftModel


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


class PositionLaw(TrackingLaw):
    """Send both joints to the latest point; they arrive together."""

    description = "straight to the latest point"

    def follow(
        self, target: TargetEstimate, joints: JointReading, now: float
    ) -> tuple[HeadCommand, Gaze]:
        """See `TrackingLaw`."""
        gaze = self._head.gaze_along(target.ray, *joints.positions)
        return self.go_to((gaze.pan, gaze.tilt), self.fastest, joints, now), gaze

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
    _held: tuple[float, float] | None

    def follow(
        self, target: TargetEstimate, joints: JointReading, now: float
    ) -> tuple[HeadCommand, Gaze]:
        """See `TrackingLaw`."""
        gaze = self._head.gaze_along(target.ray, *joints.positions)
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
        p, goals, speeds = self.parameters, [], []
        settings = (p.k_pan, p.pan_threshold), (p.k_tilt, p.tilt_threshold)
        for joint, (gain, threshold) in enumerate(settings):
            error = wanted[joint] - present[joint]
            if abs(error) <= threshold:  # a goal that stays does not follow the joint's sag
                goal = self._stopped_at.setdefault(joint, present[joint])
                speed = self.fastest
            else:
                self._stopped_at.pop(joint, None)
                goal = present[joint] + math.copysign(self.limits.lead_target_angle, error)
                speed = min(gain * abs(error), self.fastest)
            goals.append(goal)
            speeds.append(speed)
        return HeadCommand(*inside(self._head, (goals[0], goals[1])), speeds[0], speeds[1])

    def _forget(self) -> None:
        self._stopped_at: dict[int, float] = {}
        self._held = None


_LONGEST_PAUSE = 0.2  # s; after a longer pause the law starts anew
_SHORTEST = 1e-4  # s between two commands; simulated clocks may stop
_STEP_SHARE = 0.03  # of one step in the averages of the time between commands
_BUILD_UP = 0.02  # s; an acceleration that takes longer to build up is not planned
_MOVING = 0.15  # rad/s
_EDGE = 0.05  # rad; a target at the other end of the pan range is followed if this far inside

Path: TypeAlias = Callable[[float], tuple[float, float]]
"""Reference of pan and tilt [rad] at a time [s]."""


class PredictiveLaw(TrackingLaw):
    """Feed the motion of the target forward through the exact gaze.

    For each joint: the reference is the gaze at the target, predicted by the servo's delay;
    `JointMotion` plans the motion to it within the limits; `ShaftModel` has the set-point, and so
    the speed to command. The goal lies ahead, but not beyond the next positions of the reference.
    """

    Parameters = PredictiveLawParameters
    parameters: PredictiveLawParameters
    description = "with the target's predicted motion"
    _aimed: tuple[float, float] | None

    def __init__(
        self,
        head: PanTiltHead,
        period: float,
        limits: SpeedLimits | None = None,
        parameters: PredictiveLawParameters | None = None,
        servos: Mapping[str, ShaftModel] | None = None,
    ) -> None:
        pan, tilt = head.pan_joint, head.tilt_joint
        self.servos = servos or {pan: ShaftModel(), tilt: ShaftModel()}
        self._joints = (
            JointController(head.pan_limits, self.servos[pan]),
            JointController(head.tilt_limits, self.servos[tilt]),
        )
        super().__init__(head, period, limits, parameters)
        self._elapsed, self._squared = period, period * period

    def follow(
        self, target: TargetEstimate, joints: JointReading, now: float
    ) -> tuple[HeadCommand, Gaze]:
        """See `TrackingLaw`."""
        elapsed = self._receive(joints, now)
        pan, tilt = self._joints
        near = pan.motion.position, tilt.motion.position
        fastest, hardest = self.fastest, self._acceleration
        limits = [(fastest, joint.steady_acceleration(hardest)) for joint in self._joints]
        target = target.within(limits)
        gazes = [self._gaze(target, times, near) for times in self._times(now)]
        spreads = [target.spread(joint, now + lead) for joint, lead in enumerate(self.lead_times)]
        places = [(gaze.pan, gaze.tilt) for gaze in gazes]
        command = self._along(places, self.fastest, elapsed, now, spreads)
        self._aimed = places[1]
        return command, gazes[1]

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
        places = [(path(pan)[0], path(tilt)[1]) for pan, tilt in self._times(now)]
        return self._along(places, speed, elapsed, now)

    def _forget(self) -> None:
        self._stepped, self._aimed = -math.inf, None

    @property
    def _acceleration(self) -> float:
        """The highest acceleration by the parameters [rad/s^2]."""
        p = self.parameters
        return min(p.max_joint_acceleration, _BUILD_UP * p.max_joint_jerk)

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
        self._elapsed += _STEP_SHARE * (elapsed - self._elapsed)
        self._squared += _STEP_SHARE * (elapsed * elapsed - self._squared)
        for joint, position, velocity in zip(
            self._joints, joints.positions, joints.velocities, strict=True
        ):
            if anew:
                joint.restart(joints.stamp, position, velocity)
            else:
                joint.measured(joints.stamp, position, elapsed)
        return elapsed

    @property
    def _usual(self) -> float:
        """The time to the next command for which commands are planned [s].

        An error that is corrected within T is left by 1 - t/T after an actual time t. On average
        the square of that is smallest if T is the mean t² over the mean t.
        """
        return max(self._period, self._squared / self._elapsed)

    def _times(self, now: float) -> list[tuple[float, float]]:
        """Return the times [s], each of pan and tilt, when a command of now acts and ends."""
        pan, tilt = (now + delay for delay in self.delays)
        end = self._usual
        ahead = 0.0, end, end + RESERVE
        return [(pan + time, tilt + time) for time in ahead]

    def _gaze(
        self, target: TargetEstimate, times: tuple[float, float], near: tuple[float, float]
    ) -> Gaze:
        """Return the gaze at the target, predicted to a time for pan and one for tilt [s].

        The head does not turn all the way round to a target that has just come into reach at the
        other end of the pan range.
        """
        gaze = self._head.gaze_along(target.ray_at(*times), *near)
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
        places: Sequence[tuple[float, float]],
        speed: float,
        elapsed: float,
        now: float,
        spreads: Sequence[tuple[float, float, float]] = 2 * ((0.0, 0.0, 0.0),),
    ) -> HeadCommand:
        """Return the command for both joints, whose references at `_times` are `places` [rad]."""
        period = self._usual
        velocities = [(soon - here) / period for here, soon in zip(*places[:2], strict=True)]
        moving = max(map(abs, velocities)) > _MOVING
        p = self.parameters
        goals = []
        for joint, here, soon, last, velocity, spread, limits in zip(
            self._joints,
            *places,
            velocities,
            spreads,
            (self._head.pan_limits, self._head.tilt_limits),
            strict=True,
        ):
            # while one joint moves, the other does not rest either
            noise, speed_noise = (0.0, 0.0) if moving else spread[:2]
            goals.append(
                joint.follow(
                    Reference(here, velocity, noise, speed_noise, (soon, last), spread[2]),
                    now,
                    period,
                    elapsed,
                    MotionLimits(
                        min(speed, limits.velocity),
                        self._acceleration,
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
