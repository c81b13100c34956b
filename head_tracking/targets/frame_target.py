"""A frame as the target: a gripper, a frame of another program on /tf, a hand of a person."""

from __future__ import annotations

from dataclasses import dataclass

from head_tracking.parameters import ParameterError, parameter
from head_tracking.targets.skeleton import skeleton_frame
from head_tracking.tracking import Target
from head_tracking.transforms import LATEST, TransformBuffer, TransformException


@dataclass(frozen=True, slots=True)
class FrameTargetParameters:
    """The frame to look at, and its maximum age."""

    frame: str = parameter(
        "", "The frame to look at, or a skeleton's joint: head, left_hand, right_knee, ..."
    )
    offset: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "The point in that frame: x, y, z.", unit="m", minimum=-1e3, maximum=1e3
    )
    reference_frame: str = parameter(
        "base_link", "The frame in which the target is published; it must not move with the head."
    )
    max_age: float = parameter(
        0.5, "Older transforms are not published.", unit="s", minimum=0.01, maximum=60.0
    )
    mirror_skeleton: bool = parameter(
        False, "Swap left and right of a skeleton's joints, for trackers that see a mirror image."
    )
    skeleton_user: int = parameter(
        0,
        "Number of the person whose joint is meant; 0: the person seen last.",
        minimum=0,
        maximum=1000,
    )

    def __post_init__(self) -> None:
        if len(self.offset) != 3:
            raise ParameterError(f"offset is {list(self.offset)}; it needs x, y and z")


class StaleFrameError(Exception):
    """The latest transform of the frame is too old."""


class FrameTarget:
    """The origin of a frame, with an offset; `parameters` may change at any time."""

    def __init__(self, buffer: TransformBuffer, parameters: FrameTargetParameters) -> None:
        self._buffer = buffer
        self.parameters = parameters
        self._sent = LATEST

    def newest(self, now: int) -> Target | None:
        """Return the target at its latest transform; None if that was returned already.

        The stamp of a frame with static transforms only is `now` [ns].

        Raises:
            StaleFrameError: the latest transform is older than `max_age`.
            TransformException: the frame is not known, or nothing connects it.
        """
        p = self.parameters
        if not p.frame:
            raise TransformException("no frame is given: set the parameter `frame`")
        frame = skeleton_frame(
            p.frame,
            self._buffer.frames(),
            self._stamp_of,
            mirror=p.mirror_skeleton,
            user=p.skeleton_user,
        )
        found = self._buffer.lookup_transform(p.reference_frame, frame)
        stamp, point = found.stamp, found.transform @ p.offset
        if stamp == LATEST:
            return Target(now, p.reference_frame, point)
        age = (now - stamp) * 1e-9
        if abs(age) > p.max_age:
            raise StaleFrameError(
                f"the newest transform of {frame} is {age:.1f} s old (below 0: of a clock that is "
                f"ahead); allowed are {p.max_age:g} s (max_age)"
            )
        if stamp == self._sent:
            return None
        self._sent = stamp
        return Target(stamp, p.reference_frame, point)

    def _stamp_of(self, frame: str) -> int:
        try:
            return self._buffer.get_latest_common_time(self.parameters.reference_frame, frame)
        except TransformException:
            return LATEST
