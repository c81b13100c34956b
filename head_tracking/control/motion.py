"""What a head does: looks at a point once, follows a target, or holds."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeAlias

from head_tracking.exceptions import HeadTrackingError, SupersededError, UnreachableError
from head_tracking.gaze import HeadCommand, PanTiltHead, PointingResult
from head_tracking.tracking import (
    CAUTIOUS_SPEED,
    ClockWatch,
    JointReading,
    PredictiveLaw,
    Target,
    TargetPlacer,
    TargetState,
    Tracker,
    Turn,
)
from head_tracking.transforms import TransformBuffer, TransformException, Vector3

PATIENCE = 1.0
"""So long [s] a target waits for its frame, or for the joints of its stamp."""

_THRESHOLD = 0.02  # rad: largest miss that counts as arrived
_SETTLE_TIME = 0.4  # s
_CAUTIOUS_TIME = 2.0  # s after a stop

Place: TypeAlias = Callable[[], tuple[Vector3, float | None]]
"""Returns where a target is in the head's base frame [m], and when that was [s]; None: always."""


@dataclass(frozen=True, slots=True)
class Look:
    """A turn to a point that a thread waits for.

    Attributes:
        point: as it was given, shape (3,) [m].
        turn: the motion.
        place: where the point is.
        start: pan and tilt at the beginning [rad].
        result: of the turn.
    """

    point: Vector3
    turn: Turn
    place: Place
    start: tuple[float, float]
    result: Future[PointingResult]


class HeadMotion:
    """Decides in each cycle where the joints go; for any thread.

    Args:
        head: what is turned.
        frames: the robot's frames; it is given the joints that are measured.
        period: between two cycles [s].
        write: sends a command to the servos, with the epoch in which it was asked for. It is called
            with a lock held, and must not wait.

    Attributes:
        error: by how much the measured head misses its target [rad]; None: there is none.
        joints: as they were measured last; None: not yet.
    """

    def __init__(
        self,
        head: PanTiltHead,
        frames: TransformBuffer,
        period: float,
        write: Callable[[HeadCommand, int], object],
    ) -> None:
        self.error: float | None = None
        self.joints: JointReading | None = None
        self._head = head
        self._frames = frames
        self._write = write
        self._law = PredictiveLaw(head, period)
        self._tracker = Tracker(head, self._law)
        self._tracker.enable(False, 0.0)
        self._placer = TargetPlacer(frames, head.base_frame, PATIENCE)
        self._clock = ClockWatch(time.time)
        self._lock = threading.RLock()
        self._look: Look | None = None
        self._following = False
        self._epoch = 0
        self._period = period
        self._stepped = 0.0
        self._cautious_since: float | None = None  # 0: not begun

    @property
    def base_frame(self) -> str:
        """The frame that the pan joint stands in."""
        return self._head.base_frame

    @property
    def look(self) -> Look | None:
        """The turn that is under way."""
        return self._look

    @property
    def target_state(self) -> tuple[TargetState, str] | None:
        """What `follow` has come to, and why; None: no target is followed."""
        with self._lock:
            machine = self._tracker.machine
            return (machine.state, machine.reason) if self._following else None

    def place(self, target: Target) -> Place:
        """Return where a target is, each time that is asked; may wait for the joints of its stamp.

        A target that was seen, and one in a frame that the head carries, stays where it was.

        Raises:
            TransformException: it is not known.
        """
        base, at, frame = self._head.base_frame, target.stamp, target.frame_id
        if at or self._is_carried(frame):
            found = self._frames.lookup_transform(base, frame, at, PATIENCE if at else 0.0)
            point = found.transform @ target.point
            return lambda: (point, None)

        def latest() -> tuple[Vector3, float | None]:
            found = self._frames.lookup_transform(base, frame)
            return found.transform @ target.point, found.stamp * 1e-9 or None

        latest()
        return latest

    def check(self, target: Target, place: Place) -> None:
        """Refuse what cannot be looked at.

        Raises:
            TransformException: it is not known where the point is.
            UnreachableError: the head cannot point there.
        """
        where, _ = place()
        joints = self.joints
        assert joints is not None
        gaze = self._head.gaze(where, *joints.positions)
        if not gaze.reached:
            miss = self._head.miss(where, gaze.pan, gaze.tilt)
            raise UnreachableError(target.point, target.frame_id, miss, gaze.reason)

    def look_at(self, target: Target, place: Place, max_velocity: float, epoch: int) -> Look:
        """Begin to turn to a point; what is under way is superseded."""
        with self._lock:
            self.hold()
            assert self.joints is not None
            speed = max_velocity if self._cautious_since is None else CAUTIOUS_SPEED
            turn = Turn(self._head, min(speed, max_velocity), 0.0, _THRESHOLD, _SETTLE_TIME)
            self._epoch = epoch
            self._look = Look(target.point, turn, place, self.joints.positions, Future())
            return self._look

    def follow(self, target: Target, epoch: int) -> None:
        """Follow the latest target."""
        with self._lock:
            if not self._following:
                self.hold()
                self._tracker.enable(True, time.time())
                self._following = True
            self._epoch = epoch
            self._placer.offer(target, time.time())

    def hold(self, look: Look | None = None) -> None:
        """End what is under way, or only this turn, where the head is."""
        with self._lock:
            if self._look is None and not self._following:
                return
            if look is None or look is self._look:
                self._end(lambda ended: SupersededError(ended.point, ended.turn.miss))
                assert self.joints is not None
                self._write(self._law.stop(self.joints, time.time()), self._epoch)

    def abandon(self, error: HeadTrackingError, *, cautious: bool = False) -> None:
        """End what is under way, for the servos are relaxed; go on cautiously after a stop."""
        with self._lock:
            if cautious:
                self._cautious_since = 0.0
            self._end(lambda _: error)

    def update(self, stamp: int, joints: dict[str, float]) -> None:
        """Accept pan and tilt [rad], by name, as measured at a stamp [ns], and write the goals."""
        with self._lock:
            now, seen = time.time(), stamp * 1e-9
            self._frames.set_joint_positions(stamp, joints)
            jump = self._clock.check(simulated=False)
            if jump:
                self._tracker.reset(jump, now)
                self._placer.forget()
            head = self._head
            self.joints = JointReading(seen, (joints[head.pan_joint], joints[head.tilt_joint]))
            self._tracker.joints_read(seen, self.joints.positions)
            if self._look is not None:
                self._write(self._step_look(self._look, self.joints, now), self._epoch)
            elif self._following and abs(now - self._stepped) > 0.5 * self._period:
                self._stepped = now  # (cycles that were late come one after the other)
                command = self._step_target(joints, now)
                if command is not None:
                    self._write(command, self._epoch)

    def _step_look(self, look: Look, joints: JointReading, now: float) -> HeadCommand:
        turn = look.turn
        with suppress(TransformException):  # a frame that has gone: where it was last
            turn.aim(*look.place(), look.start, joints.positions, now)
        self.error = turn.miss
        result = turn.judge(now)
        if result is None:
            return self._law.along(turn.positions, turn.max_velocity, joints, now)
        if result.arrived:
            self._cautious_since = None
        self._look = None
        look.result.set_result(result)
        return HeadCommand(*turn.positions(now), turn.max_velocity, turn.max_velocity)

    def _step_target(self, joints: dict[str, float], now: float) -> HeadCommand | None:
        tracker = self._tracker
        for target, point in self._placer.place(now, joints):
            seen = target.stamp * 1e-9 if target.stamp else now
            moving = bool(target.stamp) and self._is_carried(target.frame_id)
            tracker.target_seen(seen, point, now, moving=moving)
        tracker.at_most = self._fastest(now)
        step = tracker.step(now)
        self.error = step.error
        if step.error is not None and step.error < _THRESHOLD:
            self._cautious_since = None
        return step.command

    def _fastest(self, now: float) -> float:
        """Return the highest speed now [rad/s]: low after a stop, rising if no target is met."""
        if self._cautious_since is None:
            return math.inf
        self._cautious_since = self._cautious_since or now
        return CAUTIOUS_SPEED * math.exp2(max(0.0, now - self._cautious_since - _CAUTIOUS_TIME))

    def _is_carried(self, frame: str) -> bool:
        """Return whether a frame moves when the joints do."""
        pan, tilt = self._head.pan_joint, self._head.tilt_joint
        base, look_up = self._head.base_frame, self._frames.lookup_transform
        try:
            before = look_up(base, frame, joint_positions={pan: 0.0, tilt: 0.0})
            after = look_up(base, frame, before.stamp, joint_positions={pan: 0.1, tilt: 0.1})
        except TransformException:
            return False
        return before.transform != after.transform

    def _end(self, error: Callable[[Look], HeadTrackingError]) -> None:
        look, self._look = self._look, None
        self._following = False
        self.error = None
        self._placer.forget()
        self._tracker.enable(False, time.time())
        if look is not None:
            look.result.set_exception(error(look))
