"""What was seen of a robot over a time."""

from __future__ import annotations

import bisect
import threading
from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from head_tracking.transforms import (
    RobotModel,
    Transform,
    TransformBuffer,
    TransformException,
    Vector3,
)

_PICTURE_AGE = 2_000_000_000  # ns
ERRORS = {"head_tracker": "head_tracker/tracking_error", "point_head": "point_head/pointing_error"}
"""Where each node that turns the head tells by how much it misses."""


class RecordingError(ValueError):
    """There is no recording, or a file is none; says why."""


@dataclass(frozen=True, slots=True)
class Observation:
    """The robot at one moment.

    Attributes:
        stamp: when [ns].
        joints: position of every joint that is known [rad or m].
        frames: frames outside the model, each as the transform into the model's root.
        target: where the head is to look, in the model's root [m]; None without a target.
        target_text: the target as it was sent.
        error: angle by which the head misses the target [rad].
        state: what the node that turns the head says of itself.
        target_stamp: when the target was there [ns]; None: at `stamp`.
        silent_joints: joints of the head of which nothing is heard, though somebody should tell.
        missing_nodes: nodes that should turn the head, or send it targets, and have gone.
    """

    stamp: int
    joints: Mapping[str, float] = field(default_factory=dict)
    frames: Mapping[str, Transform] = field(default_factory=dict)
    target: Vector3 | None = None
    target_text: str = ""
    error: float | None = None
    state: str = ""
    target_stamp: int | None = None
    silent_joints: tuple[str, ...] = ()
    missing_nodes: tuple[str, ...] = ()


def known_joints(buffer: TransformBuffer, model: RobotModel) -> dict[str, float]:
    """Return the latest position of every joint that is known [rad or m]."""
    found = {name: buffer.latest_joint_position(name) for name in model.independent_joints}
    return {name: latest[1] for name, latest in found.items() if latest is not None}


def outer_frames(
    buffer: TransformBuffer, model: RobotModel, without: Collection[str] = ()
) -> Mapping[str, Transform]:
    """Return the latest transforms into the model's root, of frames that are not the model's.

    Args:
        buffer: has the frames.
        model: of the robot.
        without: frames that are left out.
    """
    found = {}
    for frame in set(buffer.frames()).difference(without):
        if frame not in model.children_of_joints and frame != model.root:
            try:
                found[frame] = buffer.lookup_transform(model.root, frame).transform
            except TransformException:
                continue
    return found


@dataclass(frozen=True, slots=True)
class Moment:
    """Something that happened.

    Attributes:
        time: when, from the start of the recording [s].
        text: what.
    """

    time: float
    text: str


@dataclass(frozen=True, slots=True)
class RecordedPicture:
    """A camera's picture in a recording.

    Attributes:
        stamp: when it was recorded [ns].
        frame_id: the camera's optical frame.
        data: a JPEG or a PNG.
    """

    stamp: int
    frame_id: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Recording:
    """What was seen of a robot, oldest first; at least one observation.

    Attributes:
        seen: the observations.
        urdf: the robot's model; empty if the recording does not tell.
        moments: what a person may want to go to, oldest first.
        notice: what a person should know of it; empty for nothing.
        camera: the topic of its pictures; empty if there are none.
        pictures: what the camera saw, oldest first.

    Raises:
        RecordingError: there is no observation, or they are not in order.
    """

    seen: tuple[Observation, ...]
    urdf: str = ""
    moments: tuple[Moment, ...] = ()
    notice: str = ""
    camera: str = ""
    pictures: tuple[RecordedPicture, ...] = ()

    def __post_init__(self) -> None:
        if not self.seen:
            raise RecordingError("there is nothing in the recording")
        stamps = [one.stamp for one in self.seen]
        if stamps != sorted(stamps):
            raise RecordingError("the recording's stamps are not in order")

    @property
    def duration(self) -> float:
        """From the first to the last [s]."""
        return (self.seen[-1].stamp - self.seen[0].stamp) * 1e-9

    def at(self, time: float) -> Observation:
        """What was seen at, or last before, `time` [s] from the start."""
        stamp = self.seen[0].stamp + round(time * 1e9)
        index = bisect.bisect_right(self.seen, stamp, key=lambda one: one.stamp)
        return self.seen[max(0, index - 1)]

    def picture_at(self, time: float) -> tuple[int, RecordedPicture] | None:
        """The number of the picture that the camera saw last before `time` [s], and the picture.

        None if the camera has seen nothing in the last two seconds.
        """
        stamp = self.seen[0].stamp + round(time * 1e9)
        index = bisect.bisect_right(self.pictures, stamp, key=lambda one: one.stamp) - 1
        if index < 0 or stamp - self.pictures[index].stamp > _PICTURE_AGE:
            return None
        return index, self.pictures[index]


class LastMinute:
    """Keeps what was seen in the last `seconds`."""

    def __init__(self, seconds: float) -> None:
        self._length = round(seconds * 1e9)
        self._seen: deque[Observation] = deque()
        self._lock = threading.Lock()

    def add(self, seen: Observation) -> None:
        """Takes what is seen now."""
        with self._lock:
            if self._seen and seen.stamp < self._seen[-1].stamp:
                self._seen.clear()  # time jumped back
            self._seen.append(seen)
            while seen.stamp - self._seen[0].stamp > self._length:
                self._seen.popleft()

    def recording(self, urdf: str = "") -> Recording:
        """What is kept now, of the robot with this model; from any thread.

        Raises:
            RecordingError: that is nothing.
        """
        with self._lock:
            seen = tuple(self._seen)
        return Recording(seen, urdf)
