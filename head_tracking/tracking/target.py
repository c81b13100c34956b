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
    it waits up to `timeout` [s]. The newest one that can be placed wins.
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
    ) -> tuple[Target, Vector3] | None:
        """The newest target that can be placed, and its point in `base_frame` [m]; None: wait.

        Args:
            now: the time [s].
            moving_with_head: positions of the head's joints [rad] at which a target that was not
                seen but is meant for now is placed, if its frame moves with the head.

        Raises:
            TransformException: a target could not be placed in time; it is forgotten.
        """
        newer: list[tuple[Target, float]] = []
        late: TransformException | None = None
        while self._waiting:
            target, since = self._waiting.pop()
            try:
                point = self._place(target, moving_with_head)
            except TransformException as error:
                if now - since < self._timeout:
                    newer.append((target, since))
                else:
                    late = late or error
            else:
                self._waiting.clear()
                self._waiting.extend(reversed(newer))
                return target, point
        self._waiting.extend(reversed(newer))
        if late is not None:
            raise late
        return None

    def forget(self) -> None:
        """Drops the targets that wait."""
        self._waiting.clear()

    def _place(self, target: Target, moving_with_head: Mapping[str, float]) -> Vector3:
        given = moving_with_head if target.stamp == LATEST else {}
        placed = self._buffer.lookup_transform(
            self._base_frame, target.frame_id, target.stamp, joint_positions=given
        )
        return placed.transform @ target.point
