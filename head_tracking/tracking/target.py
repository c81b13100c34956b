"""Targets on their way from the frame they were seen in to one that stands still."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from head_tracking.transforms import (
    LATEST,
    ExtrapolationException,
    Rotation,
    Transform,
    TransformBuffer,
    TransformException,
    Vector3,
)

Array = npt.NDArray[np.float64]

_MOST_WAITING = 4096
_TOLD_AFTER = 1.0  # s; a target that still waits then has its reason told, however long it may wait
_WINDOW = 60_000_000  # ns; the base's motion is measured over two of these
_FARTHEST = 1e12  # m: the square of what is much farther is no number any more
_STEP = 0.04  # s between two rotations of the base that are kept
_AHEAD = 0.3  # s; so long the base is taken to move on after its newest pose


@dataclass(frozen=True, slots=True)
class Target:
    """A point to look at.

    Attributes:
        stamp: when it was seen [ns]; 0 if it was not seen but is meant for now.
        frame_id: the frame that `point` is given in.
        point: shape (3,) [m].
    """

    stamp: int
    frame_id: str
    point: Vector3

    def check(self) -> None:
        """Raise ValueError if it cannot be looked at from anywhere."""
        if not all(abs(number) <= _FARTHEST for number in self.point):
            what = "too far away" if all(map(math.isfinite, self.point)) else "not finite"
            raise ValueError(
                f"it is {what}; x, y and z must be numbers in metres, up to {_FARTHEST:g}"
            )

    def __str__(self) -> str:
        x, y, z = (f"{n:.3f}" if abs(n) < 1e6 else f"{n:g}" for n in self.point)
        return f"({x}, {y}, {z}) in {self.frame_id}"


class Refusal(NamedTuple):
    """A target that leads to nothing.

    Attributes:
        target: as it was sent.
        reason: why.
    """

    target: Target
    reason: str


class TargetPlacer:
    """Places targets in `fixed_frame`, with all frames as they were at each one's stamp.

    A target can come before the joint states of its stamp, or before its frame is known at all:
    it waits up to `timeout` [s].
    """

    def __init__(self, buffer: TransformBuffer, fixed_frame: str, timeout: float) -> None:
        self._buffer = buffer
        self._fixed_frame = fixed_frame
        self._timeout = timeout
        self._waiting: deque[tuple[Target, float]] = deque()
        self._refusals: list[Refusal] = []

    def offer(self, target: Target, now: float) -> None:
        """Takes a target at the time `now` [s]; one that is nowhere is refused."""
        try:
            target.check()
        except ValueError as error:
            self._refusals = [Refusal(target, str(error))]
            return
        if len(self._waiting) == _MOST_WAITING:
            dropped, _ = self._waiting.popleft()
            self._refusals = [Refusal(dropped, f"{_MOST_WAITING} targets wait already")]
        self._waiting.append((target, now))

    def place(
        self, now: float, moving_with_head: Mapping[str, float]
    ) -> list[tuple[Target, Vector3]]:
        """The targets that can be placed by now, in the order in which they came.

        Args:
            now: the time [s].
            moving_with_head: positions of the head's joints [rad] at which a target that was not
                seen but is meant for now is placed, if its frame moves with the head.

        Returns:
            Each target and its point in `fixed_frame` [m].
        """
        return [(target, point) for target, point, _ in self._take(now, moving_with_head)]

    def place_newest(
        self, now: float, moving_with_head: Mapping[str, float]
    ) -> tuple[Target, Vector3] | None:
        """The newest of them; what came before it is forgotten. None: wait. See `place`."""
        placed = self._take(now, moving_with_head)
        if not placed:
            return None
        target, point, came = placed[-1]
        self._waiting = deque(waiting for waiting in self._waiting if waiting[1] > came)
        return target, point

    def place_one(self, target: Target, moving_with_head: Mapping[str, float]) -> Vector3:
        """A target in `fixed_frame` [m], by what is known now; see `place`.

        Raises:
            TransformException: it cannot be placed, or not yet.
        """
        if target.stamp != LATEST:
            return self._buffer.transform_point(
                target.point, self._fixed_frame, target.frame_id, target.stamp
            )
        placed = self._buffer.lookup_transform(
            self._fixed_frame, target.frame_id, LATEST, joint_positions=moving_with_head
        )
        return placed.transform @ target.point

    def take_refusal(self) -> Refusal | None:
        """The newest target that led to nothing since this was asked last, and why."""
        return self._refusals.pop() if self._refusals else None

    def forget(self) -> None:
        """Drops the targets that wait."""
        self._waiting.clear()
        self._refusals.clear()

    def _take(
        self, now: float, moving_with_head: Mapping[str, float]
    ) -> list[tuple[Target, Vector3, float]]:
        """Each target that can be placed, its point, and when it came."""
        placed: list[tuple[Target, Vector3, float]] = []
        hopeless: dict[str, tuple[int, str]] = {}
        for _ in range(len(self._waiting)):
            target, came = self._waiting.popleft()
            since, reason = hopeless.get(target.frame_id, (0, ""))
            if not reason or target.stamp < since:
                try:
                    placed.append((target, self.place_one(target, moving_with_head), came))
                    continue
                except TransformException as error:
                    reason = str(error)
                    if target.stamp > self._known_until(target.frame_id):
                        hopeless[target.frame_id] = target.stamp, reason
            waited = now - came
            if 0.0 <= waited < self._timeout:  # (not if it came before the clock jumped back)
                self._waiting.append((target, came))
            if not 0.0 <= waited < min(self._timeout, _TOLD_AFTER):
                self._refusals = [Refusal(target, reason)]
        return placed

    def _known_until(self, frame_id: str) -> int:
        """The newest time [ns] for which a target in this frame could be placed."""
        try:
            return self._buffer.get_latest_common_time(self._fixed_frame, frame_id)
        except TransformException:
            return -1


class HeadBase:
    """Where the link that carries the head is in the frame where the targets are placed.

    Args:
        buffer: the robot's frames.
        fixed_frame: stands still.
        base_frame: moves with the robot.
    """

    def __init__(self, buffer: TransformBuffer, fixed_frame: str, base_frame: str) -> None:
        self._buffer = buffer
        self._frames = fixed_frame, base_frame
        self._stamp = 0.0
        self._newest = Transform.identity()
        self._motion: tuple[_Way, _Way] | None = None
        self._rotations: deque[tuple[int, float, float, float, float]] = deque()

    def update(self) -> str:
        """Takes the newest pose and the way to it; why not, or an empty string."""
        self._motion = None
        try:
            newest = self._buffer.lookup_transform(*self._frames)
            self._stamp, self._newest = newest.stamp * 1e-9, newest.transform
            if newest.stamp != LATEST:
                older, oldest = (
                    self._buffer.lookup_transform(*self._frames, newest.stamp - ago).transform
                    for ago in (_WINDOW, 2 * _WINDOW)
                )
                self._motion = _way(older, self._newest), _way(oldest, older)
        except ExtrapolationException:
            return ""  # nothing is known of its motion yet
        except TransformException as error:
            return str(error)
        return ""

    def at(self, time: float) -> Transform:
        """`T_fixed_base` at a time [s] that has been; as near to it as is known."""
        try:
            return self._buffer.lookup_transform(*self._frames, round(time * 1e9)).transform
        except TransformException:
            self.update()
            return self.pose(time)

    def rotations(self, times: Array) -> Array:
        """Return `R_fixed_base` at times [s], shape (N,), as quaternions x y z w, shape (4, N).

        They lie between rotations 40 ms apart, each of which is looked up once; not normalised.
        """
        first, last = math.floor(times.min() / _STEP), math.ceil(times.max() / _STEP)
        known = self._rotations
        while known and known[0][0] < first:
            known.popleft()
        if known and known[0][0] > first:
            known.clear()
        for step in range(known[-1][0] + 1 if known else first, last + 1):
            x, y, z, w = rotation = self.at(step * _STEP).rotation
            if known and sum(a * b for a, b in zip(rotation, known[-1][1:], strict=True)) < 0.0:
                x, y, z, w = -x, -y, -z, -w
            known.append((step, x, y, z, w))
        steps, *columns = np.array(known).T
        return np.array([np.interp(times / _STEP, steps, column) for column in columns])

    def pose(self, time: float) -> Transform:
        """`T_fixed_base` at a time [s] near now, with the velocity and acceleration it had last."""
        if self._motion is None:
            return self._newest
        last, before = self._motion
        windows = min(time - self._stamp, _AHEAD) / (_WINDOW * 1e-9)
        bend = 0.5 * windows * (windows + 1.0)
        x, y, z, a, b, c = (
            windows * new + bend * (new - old) for new, old in zip(last, before, strict=True)
        )
        angle = math.hypot(a, b, c)
        turn = (
            Rotation.from_axis_angle((a / angle, b / angle, c / angle), angle)
            if angle > 0.0
            else Rotation(0.0, 0.0, 0.0, 1.0)
        )
        return self._newest @ Transform((x, y, z), turn)


_Way = tuple[float, float, float, float, float, float]


def _way(start: Transform, end: Transform) -> _Way:
    """The translation and the small rotation vector from one pose to the next, in the first."""
    x, y, z, a, b, c, w = start.inverse() @ end
    twice = math.copysign(2.0, w)
    return x, y, z, twice * a, twice * b, twice * c
