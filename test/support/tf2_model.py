"""tf2's rules, written down as plainly as can be from what its sources do; to compare with.

A frame is a list of samples, newest first, or one static sample. A lookup walks from the source up
to where the tree ends, or where nothing is known of that time, and then from the target up to
there. Matrices; nothing is remembered from one lookup to the next.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from head_tracking.transforms import Rotation, Transform

Matrix = np.ndarray


class Refused(Exception):
    """What tf2 raises; the argument is the name of its exception."""


class Climbed(set[str]):
    """The frames of a climb; one that comes twice is in a loop, in which tf2 gives up."""

    def add(self, frame: str) -> None:
        if frame in self:
            raise Refused("LookupException")
        super().add(frame)


@dataclass
class Sample:
    stamp: int
    parent: str
    transform: Any  # a Transform; of a joint, its position


@dataclass
class Frame:
    static: Sample | None = None
    samples: list[Sample] = field(default_factory=list)

    def insert(self, new: Sample, cache_time: int) -> None:
        """TimeCache: prune by the newest there is, then insert unless that is too old."""
        latest = self.samples[0].stamp if self.samples else 0
        while self.samples and self.samples[-1].stamp + cache_time < latest:
            self.samples.pop()
        if self.samples and new.stamp < latest - cache_time:
            return
        place = 0
        while place < len(self.samples) and self.samples[place].stamp > new.stamp:
            place += 1
        if new not in self.samples:
            self.samples.insert(place, new)

    def closest(self, stamp: int) -> tuple[Sample, Sample | None] | None:
        """The sample to use, or the older and the newer one to interpolate between."""
        samples = self.samples
        if not samples:
            return None
        if stamp in (0, samples[0].stamp):
            return samples[0], None
        if stamp == samples[-1].stamp:
            return samples[-1], None
        if not samples[-1].stamp < stamp < samples[0].stamp:
            return None
        older = next(i for i, sample in enumerate(samples) if sample.stamp <= stamp)
        return samples[older], samples[older - 1]

    def at(self, stamp: int) -> tuple[str, Matrix] | None:
        """The parent, and T_parent_child."""
        if self.static is not None:
            return self.static.parent, self.static.transform.as_matrix()
        found = self.closest(stamp)
        if found is None:
            return None
        older, newer = found
        if newer is None or older.parent != newer.parent:
            return older.parent, older.transform.as_matrix()
        ratio = (stamp - older.stamp) / (newer.stamp - older.stamp)
        return older.parent, between(older.transform, newer.transform, ratio)

    def latest(self) -> tuple[int, str] | None:
        if self.static is not None:
            return 0, self.static.parent
        return (self.samples[0].stamp, self.samples[0].parent) if self.samples else None


class Tf2Model:
    """What a buffer is asked in the tests."""

    def __init__(self, cache_time: int = 10_000_000_000) -> None:
        self.cache_time = cache_time
        self.frames: dict[str, Frame] = {}
        self.names: set[str] = set()

    def set_transform(
        self, stamp: int, parent: str, child: str, transform: Transform, *, static: bool
    ) -> None:
        self.names |= {parent, child}
        sample = Sample(stamp, parent, transform)
        if static:
            self.frames[child] = Frame(sample)
            return
        if child not in self.frames or self.frames[child].static is not None:
            self.frames[child] = Frame()
        self.frames[child].insert(sample, self.cache_time)

    def clear(self) -> None:
        for frame in self.frames.values():
            frame.samples.clear()

    def lookup(self, target: str, source: str, stamp: int) -> tuple[int, Matrix]:
        """The time of the answer and T_target_source."""
        if target == source:
            latest = self.frames[source].latest() if source in self.frames else None
            return stamp or (latest[0] if latest else 0), np.eye(4)
        if not {target, source} <= self.names:
            raise Refused("LookupException")
        if stamp == 0:
            stamp = self.latest_common_time(target, source)
        up, frame, gap = np.eye(4), source, False
        climbed = Climbed()
        while frame in self.frames:
            climbed.add(frame)
            found = self.frames[frame].at(stamp)
            if found is None:
                gap = True
                break
            if frame == target:
                return stamp, up
            up, frame = found[1] @ up, found[0]
        top, down, frame = frame, np.eye(4), target
        climbed = Climbed()
        while frame != top and frame in self.frames:
            climbed.add(frame)
            found = self.frames[frame].at(stamp)
            if found is None:
                raise Refused("ExtrapolationException")
            if frame == source:
                return stamp, np.linalg.inv(down)
            down, frame = found[1] @ down, found[0]
        if frame != top:
            raise Refused("ExtrapolationException" if gap else "ConnectivityException")
        return stamp, np.linalg.inv(down) @ up

    def latest_common_time(self, target: str, source: str) -> int:
        above: list[tuple[int, str]] = []
        frame, climbed = source, Climbed()
        while frame in self.frames and (latest := self.frames[frame].latest()) is not None:
            climbed.add(frame)
            above.append(latest)
            frame = latest[1]
            if frame == target:
                return oldest(above)
        below: list[tuple[int, str]] = []
        frame, climbed = target, Climbed()
        while frame in self.frames and (latest := self.frames[frame].latest()) is not None:
            climbed.add(frame)
            below.append(latest)
            frame = latest[1]
            parents = [parent for _, parent in above]
            if frame in parents:
                return oldest(below + above[: parents.index(frame) + 1])
            if frame == source:
                return oldest(below)
        raise Refused("ConnectivityException")


def oldest(stamped: list[tuple[int, str]]) -> int:
    """A stamp of 0 is that of a static frame, and does not count."""
    return min((stamp for stamp, _ in stamped if stamp), default=0)


def between(older: Transform, newer: Transform, ratio: float) -> Matrix:
    """Straight on, and turning about one axis at constant speed, the short way."""
    turn = older.rotation.inverse() @ newer.rotation
    axis = np.array(turn[:3])
    if turn.w < 0:
        turn, axis = Rotation(*(-component for component in turn)), -axis
    norm = float(np.linalg.norm(axis))
    part = Rotation.identity()
    if norm > 1e-15:
        part = Rotation.from_axis_angle(axis / norm, ratio * 2 * math.atan2(norm, turn.w))
    matrix = np.eye(4)
    matrix[:3, :3] = (older.rotation @ part).as_matrix()
    matrix[:3, 3] = (1 - ratio) * np.array(older.translation) + ratio * np.array(newer.translation)
    return matrix
