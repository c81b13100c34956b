"""What a head is asked to do once: turn to a point, or follow a trajectory.

Each task is carried out step by step in the loop; a newer one ends the older.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from head_tracking.compatibility import StrEnum
from head_tracking.gaze import HeadCommand
from head_tracking.tracking import (
    JointPoint,
    JointReading,
    JointTrajectory,
    PredictiveLaw,
    Target,
    TrajectoryCode,
    Turn,
)
from head_tracking.transforms import TransformException, Vector3

if TYPE_CHECKING:
    from head_tracking.head.head_control import HeadControl

_PERIOD = 0.02  # s
_PROGRESS_PERIOD = 0.035  # s


class TaskEnd(StrEnum):
    """How a task ended."""

    SUCCEEDED = "succeeded"
    MISSED = "did not arrive"
    UNREACHABLE = "unreachable"
    PREEMPTED = "preempted"
    DISABLED = "disabled"
    CANCELED = "canceled"
    ABORTED = "aborted"


@dataclass(frozen=True, slots=True)
class TaskResult:
    """The result of a task.

    Attributes:
        end: how it ended.
        reason: for a person.
        code: as in FollowJointTrajectory.
    """

    end: TaskEnd
    reason: str
    code: TrajectoryCode = TrajectoryCode.INVALID_GOAL

    def __str__(self) -> str:
        if self.end is TaskEnd.SUCCEEDED:
            return self.reason
        what = TaskEnd.CANCELED if self.end is TaskEnd.CANCELED else TaskEnd.ABORTED
        return f"{what}: {self.reason}"


class HeadReading(NamedTuple):
    """The head as it was measured last.

    Attributes:
        now: the time [s].
        stamp: when it was measured [s].
        positions: pan and tilt [rad].
    """

    now: float
    stamp: float
    positions: tuple[float, float]

    @property
    def joints(self) -> JointReading:
        """The measurement alone."""
        return JointReading(self.stamp, self.positions)


class HeadTask(ABC):
    """Turns the head until it has a result.

    Args:
        notify: called with the task while it is under way and, once, when it has its result; with
            the lock of `HeadControl` held. None: it is one of a stream, for whose end nobody waits.

    Attributes:
        title: what it does.
        result: how it ended; None while it is under way.
        miss: by how much the head misses what it is turned to [rad]; None: not known.
        reading: of the latest step; None: it has not begun.
        start: commanded pan and tilt at the beginning [rad].
    """

    title: str

    def __init__(self, notify: Callable[[HeadTask], object] | None) -> None:
        self.result: TaskResult | None = None
        self.miss: float | None = None
        self.reading: HeadReading | None = None
        self.start = (0.0, 0.0)
        self.is_streamed = notify is None
        self._notify = notify or (lambda _: None)
        self._notified = -math.inf

    @abstractmethod
    def step(self, reading: HeadReading, law: PredictiveLaw) -> HeadCommand | None:
        """Return what to do now."""

    @abstractmethod
    def desired(self, time: float) -> tuple[JointPoint, JointPoint] | None:
        """Return the desired states of pan and tilt at a time [s]; None: wherever they are."""

    def report(self, now: float) -> None:
        """Notify of the progress, unless that was done just before."""
        if self.result is None and abs(now - self._notified) > _PROGRESS_PERIOD:
            self._notified = now
            self._notify(self)

    def end(
        self, end: TaskEnd, reason: str, code: TrajectoryCode = TrajectoryCode.INVALID_GOAL
    ) -> None:
        """Set the result, unless there is one."""
        if self.result is None:
            self.result = TaskResult(end, reason, code)
            self._notify(self)


class PointTask(HeadTask):
    """A turn to a point until the measured joints have arrived.

    Args:
        notify: see `HeadTask`.
        control: of the head.
        target: what to look at. A frame that the head carries would run before it: the point stays
            where it was.
        turn: the motion.
        clamp: turn as far as the joints go; else a point out of reach ends it.
        follows: whether a frame that moves is followed; else the point stays where it was at its
            stamp.
    """

    def __init__(
        self,
        notify: Callable[[HeadTask], object] | None,
        control: HeadControl,
        target: Target,
        turn: Turn,
        *,
        clamp: bool,
        follows: bool = True,
    ) -> None:
        super().__init__(notify)
        self.title = f"turning {turn.head.pointing_frame} to {target}"
        self.target = target
        self._control = control
        self._turn = turn
        self._clamp = clamp
        self._follows = follows and not control.is_carried(target.frame_id)
        self._placed: float | None = None
        self._fixed: Vector3 | None = None

    def step(self, reading: HeadReading, law: PredictiveLaw) -> HeadCommand | None:
        """See `HeadTask`."""
        now, positions, turn = reading.now, reading.positions, self._turn
        moves = turn.miss is not None
        since = self._placed = now if self._placed is None else self._placed
        try:
            point, stamp = self._place(now)
        except TransformException as error:
            if now - since >= self._control.transform_timeout:
                self.end(TaskEnd.ABORTED, f"the target {self.target} cannot be placed: {error}")
            return law.stop(reading.joints) if moves and self.result else None
        gaze = turn.aim(point, stamp, self.start, positions, now)
        if not gaze.is_usable(clamp=self._clamp):
            self.end(TaskEnd.UNREACHABLE, gaze.reason)
            return law.stop(reading.joints) if moves else None
        self.miss = turn.miss
        self._placed = now
        result = turn.judge(now)
        if result is None:
            return law.along(turn.positions, turn.max_velocity, reading.joints, now)
        if result.arrived:
            self.end(TaskEnd.SUCCEEDED, str(result), TrajectoryCode.SUCCESSFUL)
        else:
            why = f" ({gaze.reason})" if gaze.reason else ""
            self.end(TaskEnd.MISSED, f"{result}{why}")
        return HeadCommand(*turn.positions(now), turn.max_velocity, turn.max_velocity)

    def desired(self, time: float) -> tuple[JointPoint, JointPoint] | None:
        """See `HeadTask`."""
        if self._turn.miss is None:
            return None
        here, soon = self._turn.positions(time), self._turn.positions(time + _PERIOD)
        pan, tilt = (JointPoint(a, (b - a) / _PERIOD, 0.0) for a, b in zip(here, soon, strict=True))
        return pan, tilt

    def _place(self, now: float) -> tuple[Vector3, float | None]:
        """Return the target from the head's base, and its stamp [s]; None: it stands still."""
        if self._follows:
            return self._control.place_latest(self.target)
        if self._fixed is None:
            self._fixed = self._control.place_at_stamp(self.target, self.start)
        return self._control.from_base(self._fixed, now), None


class TrajectoryTask(HeadTask):
    """A trajectory, until the measured joints are at its end.

    Args:
        notify: see `HeadTask`.
        trajectory: of both joints.
    """

    title = "following a trajectory"

    def __init__(
        self, notify: Callable[[HeadTask], object] | None, trajectory: JointTrajectory
    ) -> None:
        super().__init__(notify)
        self.trajectory = trajectory

    def step(self, reading: HeadReading, law: PredictiveLaw) -> HeadCommand | None:
        """See `HeadTask`."""
        now = reading.now
        result = self.trajectory.judge(reading.stamp, reading.positions, now)
        if result is None:
            return law.along(self._positions, law.fastest, reading.joints, now)
        if result.code is TrajectoryCode.SUCCESSFUL:
            self.end(TaskEnd.SUCCEEDED, result.text, result.code)
            return HeadCommand(*self._positions(now), law.fastest, law.fastest)
        self.end(TaskEnd.ABORTED, result.text, result.code)
        return law.stop(reading.joints)

    def desired(self, time: float) -> tuple[JointPoint, JointPoint] | None:
        """See `HeadTask`."""
        pan, tilt = self.trajectory.at(time)
        return pan, tilt

    def _positions(self, time: float) -> tuple[float, float]:
        pan, tilt = self.trajectory.at(time)
        return pan.position, tilt.position
