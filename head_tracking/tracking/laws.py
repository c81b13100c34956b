"""The tracking laws: each turns a target into commands for the joints.

Position goes where the target was seen last, speed is the tutorials', and predictive moves the head
now as the target will move when the servos act.
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
        80.0, "Hardest acceleration.", unit="rad/s^2", minimum=1.0, maximum=500.0
    )
    max_joint_jerk: float = parameter(
        6000.0, "Hardest change of acceleration.", unit="rad/s^3", minimum=10.0, maximum=1e5
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
class NoParameters:
    """Of a law that has none of its own."""


def inside(head: PanTiltHead, positions: tuple[float, float]) -> tuple[float, float]:
    """Pan and tilt [rad], or the limits next to them: an encoder may read a little beyond."""
    return head.pan_limits.clamp(positions[0]), head.tilt_limits.clamp(positions[1])


class TrackingLaw(ABC):
    """Steers the head. Times are in seconds, on the clock of the stamps.

    Its methods are given the newest reading of the joints and the time.

    Args:
        head: the head to steer.
        period: time between two commands [s].
        limits: of all laws.
        parameters: the law's own, of its class `Parameters`.

    Attributes:
        Parameters: a dataclass of parameters; their names differ from those of the other laws.
        description: what it does, for who chooses one.
        usual_speed: the fastest [rad/s], where the limits say nothing.
        limits: may change at any time.
        parameters: may change at any time.
        at_most: no motion is faster than this [rad/s] for the time being, whatever is allowed.
        is_learning: whether it learns how late the servos are.
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
        """The fastest speed now [rad/s]."""
        return min(self.limits.max_joint_speed or self.usual_speed, self.at_most)

    @property
    def delays(self) -> tuple[float, float]:
        """From a command to the motion it causes, of pan and tilt [s]."""
        return 0.0, 0.0

    @property
    def learned(self) -> Mapping[str, LearnedValue]:
        """What is learned of the servos, by name."""
        return {}

    @property
    def to_save(self) -> Mapping[str, ServoValues]:
        """What is worth knowing of the servos in another run, by joint."""
        return {}

    def forget_learned(self) -> None:  # noqa: B027 - some laws learn nothing
        """Forget what was learned."""

    def expect(self, saved: Mapping[str, ServoValues]) -> None:  # noqa: B027
        """Begin with what an earlier run has learned of the servos, by joint."""

    def take_contradicted(self) -> Sequence[str]:
        """Return joints whose saved values have turned out not to fit since the last call."""
        return ()

    @property
    def lead_times(self) -> tuple[float, float]:
        """How far ahead of a command pan and tilt of the target are needed [s].

        Predictions are scored over these times.
        """
        return 0.0, 0.0

    @property
    def horizon(self) -> float:
        """The mean of `lead_times` [s]."""
        return 0.5 * sum(self.lead_times)

    @abstractmethod
    def follow(
        self, target: TargetEstimate, joints: JointReading, now: float
    ) -> tuple[HeadCommand, Gaze]:
        """The command that keeps the head on a target, and the gaze it aims at."""

    @abstractmethod
    def go_to(
        self, goal: tuple[float, float], speed: float, joints: JointReading, now: float
    ) -> HeadCommand:
        """The command for a way to pan and tilt [rad], not faster than `speed` [rad/s]."""

    def stop(self, joints: JointReading) -> HeadCommand:
        """The command that stops the head at once: the goal is the present position."""
        self._forget()
        return HeadCommand(*inside(self._head, joints.positions), self.fastest, self.fastest)

    def _forget(self) -> None:  # noqa: B027 - some laws remember nothing
        """Forget what the head was about."""


class PositionLaw(TrackingLaw):
    """Both joints go to the newest point and arrive together; it knows nothing of motion.

    If the node dies, the head still goes where the target last was.
    """

    description = "straight to the newest point"

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
    """Speeds in proportion to the errors of pan and tilt."""

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
        """See `TrackingLaw`; it knows no motion of the target and aims at the newest point."""
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
        """The command for now.

        Args:
            wanted: pan and tilt that look at the target [rad].
            present: pan and tilt as measured [rad].
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


_LONGEST_PAUSE = 0.2  # s; after a longer one the law starts anew
_SHORTEST = 1e-4  # s between two commands; simulated clocks can stand still
_BUILD_UP = 0.02  # s; an acceleration that takes longer to build up cannot be braked with
_MOVING = 0.15  # rad/s
_EDGE = 0.05  # rad; so far inside the far end of its range a target must be to be followed there
_ALIKE = 0.003  # s; delays that differ by less are taken to be the same

Path: TypeAlias = Callable[[float], tuple[float, float]]
"""Where pan and tilt should be [rad] at a time [s]."""


class PredictiveLaw(TrackingLaw):
    """Move the head now as the target will move when the servos act.

    Each joint is steered in three steps: where it should be after its servo's delay (the exact gaze
    at the predicted target), how it gets there within its limits (`JointMotion`), and at which
    speed the servo's set-point must move for that (`ServoModel`). A command is a speed with a goal
    ahead, and the goal is never beyond the places where the joint should be next.
    """

    Parameters = PredictiveLawParameters
    description = "with the target's motion"
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
            path: where pan and tilt should be at a time.
            speed: not to be exceeded [rad/s].
            joints: as they were measured last.
            now: the time [s].
        """
        elapsed = self._receive(joints, now)
        self._aimed = None
        return self._along(path, speed, elapsed, now)

    def _forget(self) -> None:
        self._stepped, self._aimed = -math.inf, None

    def _receive(self, joints: JointReading, now: float) -> float:
        """Give both joints their reading; after a pause they start anew.

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
        """The gaze at the predicted target.

        A target that comes into reach at the far end of the range is not followed there, all the
        way round, before it is well inside: it may be gone again at once.
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
        """The command for both joints, each at its own delay."""
        starts = [now + delay for delay in self.delays]
        if abs(starts[1] - starts[0]) < _ALIKE:
            starts[1] = starts[0]
        ahead = (0.0, self._period, self._period + RESERVE)
        places = {start: [path(start + time) for time in ahead] for start in set(starts)}
        references = []
        for index, start in enumerate(starts):
            here, *later = (place[index] for place in places[start])
            references.append(Reference(here, (later[0] - here) / self._period, ahead=tuple(later)))
        moving = max(abs(reference.velocity) for reference in references) > _MOVING
        p = self.parameters
        acceleration = min(p.max_joint_acceleration, _BUILD_UP * p.max_joint_jerk)
        goals = []
        for joint, wanted, (noise, speed_noise), limits in zip(
            self._joints,
            references,
            deviations,
            (self._head.pan_limits, self._head.tilt_limits),
            strict=True,
        ):
            reference = wanted
            if not moving:  # one joint alone does not come to rest early
                reference = replace(wanted, noise=noise, speed_noise=speed_noise)
            goals.append(
                joint.follow(
                    reference,
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
"""All that a law needs is an entry here: `head_tracker` declares its parameters and offers it."""
