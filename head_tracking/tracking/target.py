"""Targets on their way from the frame they were seen in to one that stands still."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from head_tracking.transforms import (
    LATEST,
    InvalidArgumentException,
    TransformBuffer,
    TransformException,
    Vector3,
)

_MOST_WAITING = 32


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

    def __str__(self) -> str:
        x, y, z = self.point
        return f"({x:.3f}, {y:.3f}, {z:.3f}) in {self.frame_id}"


class TargetPlacer:
    """Places targets in `base_frame`, with the joints as they were at each one's stamp.

    A target can come before the joint states of its stamp, or before its frame is known at all:
    it waits up to `timeout` [s].
    """

    def __init__(self, buffer: TransformBuffer, base_frame: str, timeout: float) -> None:
        self._buffer = buffer
        self._base_frame = base_frame
        self._timeout = timeout
        self._waiting: deque[tuple[Target, float]] = deque(maxlen=_MOST_WAITING)

    def offer(self, target: Target, now: float) -> None:
        """Takes a target at the time `now` [s].

        Raises:
            InvalidArgumentException: its numbers are not finite.
        """
        if not all(map(math.isfinite, target.point)):
            raise InvalidArgumentException(
                f"the target {target} is not finite; x, y and z must be numbers in metres"
            )
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
            Each target and its point in `base_frame` [m].

        Raises:
            TransformException: no target could be placed, and one of them not in time; it is
                forgotten.
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
        newer = [waiting for waiting in self._waiting if waiting[1] > came]
        self._waiting.clear()
        self._waiting.extend(newer)
        return target, point

    def _take(
        self, now: float, moving_with_head: Mapping[str, float]
    ) -> list[tuple[Target, Vector3, float]]:
        """Each target that can be placed, its point, and when it came."""
        placed, late = [], None
        for _ in range(len(self._waiting)):
            target, since = self._waiting.popleft()
            try:
                placed.append((target, self._place(target, moving_with_head), since))
            except TransformException as error:
                if now - since < self._timeout:
                    self._waiting.append((target, since))
                else:
                    late = error
        if late is not None and not placed:
            raise late
        return placed

    def forget(self) -> None:
        """Drops the targets that wait."""
        self._waiting.clear()

    def _place(self, target: Target, moving_with_head: Mapping[str, float]) -> Vector3:
        given = moving_with_head if target.stamp == LATEST else {}
        placed = self._buffer.lookup_transform(
            self._base_frame, target.frame_id, target.stamp, joint_positions=given
        )
        return placed.transform @ target.point
