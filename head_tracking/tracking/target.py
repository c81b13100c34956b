"""Targets, their transform into a fixed frame, and the pose of the head's base."""

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
_REPORTED_AFTER = 1.0  # s; the reason of a target that still waits then is reported
_WINDOW = 60_000_000  # ns; the motion of the base is measured over two of these
_FARTHEST = 1e12  # m: squares of much larger numbers overflow
_STEP = 0.04  # s between two stored rotations of the base
_AHEAD = 0.3  # s; longest extrapolation of the base's pose
_OLD = 1.0  # s; a pose of the base that is so far from now is reported


@dataclass(frozen=True, slots=True)
class Target:
    """A point to look at.

    Attributes:
        stamp: when it was seen [ns]; 0: the point is meant for now.
        frame_id: frame of `point`.
        point: shape (3,) [m].
    """

    stamp: int
    frame_id: str
    point: Vector3

    def check(self) -> None:
        """Raise ValueError if a coordinate is not finite or too large."""
        if not all(abs(number) <= _FARTHEST for number in self.point):
            what = "too far away" if all(map(math.isfinite, self.point)) else "not finite"
            raise ValueError(
                f"it is {what}; x, y and z must be numbers in metres, up to {_FARTHEST:g}"
            )

    def __str__(self) -> str:
        x, y, z = (f"{n:.3f}" if abs(n) < 1e6 else f"{n:g}" for n in self.point)
        return f"({x}, {y}, {z}) in {self.frame_id}"


class Refusal(NamedTuple):
    """A refused target.

    Attributes:
        target: as it was sent.
        reason: reason for the refusal.
    """

    target: Target
    reason: str


class TargetPlacer:
    """Transform targets into `fixed_frame` at their stamps.

    Attributes:
        timeout: how long a target waits for its transform [s].
    """

    def __init__(self, buffer: TransformBuffer, fixed_frame: str, timeout: float) -> None:
        self._buffer = buffer
        self._fixed_frame = fixed_frame
        self.timeout = timeout
        self._waiting: deque[tuple[Target, float]] = deque()
        self._refusals: list[Refusal] = []

    def offer(self, target: Target, now: float) -> None:
        """Accept a target at the time `now` [s]; an invalid one is refused."""
        try:
            target.check()
        except ValueError as error:
            self.refuse(target, str(error))
            return
        if len(self._waiting) == _MOST_WAITING:
            dropped, _ = self._waiting.popleft()
            self.refuse(dropped, f"{_MOST_WAITING} targets wait already")
        self._waiting.append((target, now))

    def refuse(self, target: Target, reason: str) -> None:
        """Refuse a target; see `take_refusal`."""
        self._refusals = [Refusal(target, reason)]

    def place(
        self, now: float, moving_with_head: Mapping[str, float], *, latest_only: bool = False
    ) -> list[tuple[Target, Vector3]]:
        """Return the targets that can be transformed now, in order of arrival.

        Args:
            now: the time [s].
            moving_with_head: positions of the head's joints [rad] for targets with stamp 0 in a
                frame that moves with the head.
            latest_only: return the latest of them only, and discard all that arrived before it.

        Returns:
            Each target and its point in `fixed_frame` [m].
        """
        placed: list[tuple[Target, Vector3]] = []
        hopeless: dict[str, tuple[int, str]] = {}
        arrival = 0.0  # of the last one in `placed`
        for _ in range(len(self._waiting)):
            target, came = self._waiting.popleft()
            waited = now - came
            since, reason = hopeless.get(target.frame_id, (0, ""))
            if not reason or target.stamp < since:
                try:
                    point = self.place_one(target, moving_with_head)
                    if waited <= max(self.timeout, _REPORTED_AFTER):
                        placed.append((target, point))
                        arrival = came
                        continue
                    reason = f"it came {waited:.1f} s ago, before the joints were measured"
                except TransformException as error:
                    reason = str(error)
                    if target.stamp > self._known_until(target.frame_id):
                        hopeless[target.frame_id] = target.stamp, reason
            if 0.0 <= waited < self.timeout:  # below 0: the clock has jumped back
                self._waiting.append((target, came))
            if not 0.0 <= waited < min(self.timeout, _REPORTED_AFTER):
                self.refuse(target, reason)
        if latest_only and placed:
            self._waiting = deque(each for each in self._waiting if each[1] > arrival)
            del placed[:-1]
        return placed

    def place_one(self, target: Target, moving_with_head: Mapping[str, float]) -> Vector3:
        """Return a target in `fixed_frame` [m]; see `place`.

        Raises:
            TransformException: the transform is unknown, or not known yet.
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
        """Return the latest refusal since the last call; None: there was none."""
        return self._refusals.pop() if self._refusals else None

    def forget(self) -> None:
        """Discard the targets that wait."""
        self._waiting.clear()
        self._refusals.clear()

    def _known_until(self, frame_id: str) -> int:
        """Return the latest time [ns] at which a target in this frame can be transformed."""
        try:
            return self._buffer.get_latest_common_time(self._fixed_frame, frame_id)
        except TransformException:
            return -1


class HeadBase:
    """Pose of the link that carries the head in the fixed frame.

    Args:
        buffer: transforms of the robot.
        fixed_frame: the frame that does not move.
        base_frame: the link that carries the head.
    """

    def __init__(self, buffer: TransformBuffer, fixed_frame: str, base_frame: str) -> None:
        self._buffer = buffer
        self._frames = fixed_frame, base_frame
        self._stamp = 0.0
        self._latest = Transform.identity()
        self._motion: tuple[_Motion, _Motion] | None = None
        self._rotations: deque[tuple[int, float, float, float, float]] = deque()
        self._measured = 0.0  # s; later ones were extrapolated; 0: the base never moves

    def update(self) -> str:
        """Update pose and motion; return the error, or an empty string."""
        self._motion = None
        try:
            latest = self._buffer.lookup_transform(*self._frames)
            self._stamp, self._latest = latest.stamp * 1e-9, latest.transform
            if latest.stamp != LATEST:
                older, oldest = (
                    self._buffer.lookup_transform(*self._frames, latest.stamp - ago).transform
                    for ago in (_WINDOW, 2 * _WINDOW)
                )
                self._motion = _motion_between(older, self._latest), _motion_between(oldest, older)
        except ExtrapolationException:
            return ""  # the motion is not known yet
        except TransformException as error:
            return str(error)
        return ""

    def out_of_time(self, now: float) -> str:
        """Return that the pose is not of now, if so: it is extrapolated by a short time only."""
        if self._stamp and abs(now - self._stamp) >= _OLD:
            self.update()  # perhaps it was not needed: there was no target
        age, (fixed, base) = now - self._stamp, self._frames
        if not self._stamp or abs(age) < _OLD:
            return ""
        if age < 0.0:
            return (
                f"the transform from {base} to {fixed} lies {-age:.1f} s in the future: the clocks "
                "of its sender and of this machine differ"
            )
        return f"no transform from {base} to {fixed} for {age:.1f} s: the last one is used"

    def at(self, time: float) -> Transform:
        """Return `T_fixed_base` at a past time [s], extrapolated if necessary."""
        try:
            return self._buffer.lookup_transform(*self._frames, round(time * 1e9)).transform
        except TransformException:
            self.update()
            return self.pose(time)

    def rotations(self, times: Array) -> Array:
        """Return `R_fixed_base` at times [s], shape (N,), as quaternions x y z w, shape (4, N).

        They are interpolated between rotations 40 ms apart, and not normalised.
        """
        first, last = math.floor(times.min() / _STEP), math.ceil(times.max() / _STEP)
        known = self._rotations
        while known and known[0][0] < first:
            known.popleft()
        while known and known[-1][0] * _STEP > self._measured > 0.0:
            known.pop()  # it was extrapolated
        if known and known[0][0] > first:
            known.clear()
        for step in range(known[-1][0] + 1 if known else first, last + 1):
            x, y, z, w = rotation = self.at(step * _STEP).rotation
            if known and sum(a * b for a, b in zip(rotation, known[-1][1:], strict=True)) < 0.0:
                x, y, z, w = -x, -y, -z, -w
            known.append((step, x, y, z, w))
        self._measured = self._stamp
        steps, *columns = np.array(known).T
        return np.array([np.interp(times / _STEP, steps, column) for column in columns])

    def pose(self, time: float) -> Transform:
        """Return `T_fixed_base` at a time [s] near now, extrapolated with constant acceleration."""
        if self._motion is None:
            return self._latest
        last, before = self._motion
        windows = max(-_AHEAD, min(time - self._stamp, _AHEAD)) / (_WINDOW * 1e-9)
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
        return self._latest @ Transform((x, y, z), turn)


_Motion = tuple[float, float, float, float, float, float]


def _motion_between(start: Transform, end: Transform) -> _Motion:
    """Return translation and small rotation vector from `start` to `end`, in axes of `start`."""
    x, y, z, a, b, c, w = start.inverse() @ end
    twice = math.copysign(2.0, w)
    return x, y, z, twice * a, twice * b, twice * c
