"""A transform buffer with joints as plain as can be, to compare the real one with."""

from __future__ import annotations

import math
from collections import defaultdict

from tf2_model import Frame, Matrix, Sample, Tf2Model

from head_tracking.transforms import RobotModel, Transform


class NaiveBuffer:
    """The joints' samples; a lookup makes the frames of its time anew, by tf2's rules."""

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        self._given = Tf2Model()
        self._joints: dict[str, Frame] = defaultdict(Frame)

    def set_joint(self, stamp: int, name: str, position: float) -> None:
        self._joints[name].insert(Sample(stamp, name, position), self._given.cache_time)

    def set_transform(self, stamp: int, parent: str, child: str, transform: Transform) -> None:
        self._given.set_transform(stamp, parent, child, transform, static=False)

    def matrix(self, target: str, source: str, stamp: int) -> Matrix:
        """T_target_source at a stamp other than 0; raises Refused."""
        then = Tf2Model()
        then.names |= {*self._model.links, *self._given.names}
        then.frames |= self._given.frames
        for joint in self._model.joints.values():
            position = self._position(joint.name, stamp) if joint.moves else 0.0
            if position is not None:
                transform = joint.transform(position)
                then.set_transform(stamp, joint.parent, joint.child, transform, static=True)
        return then.lookup(target, source, stamp)[1]

    def _position(self, name: str, stamp: int) -> float | None:
        leader = self._model.leader(name)
        found = self._joints[leader.joint].closest(stamp)
        if found is None:
            return None
        older, newer = found
        position: float = older.transform
        if newer is not None:
            difference = newer.transform - position
            if self._model.joints[leader.joint].type == "continuous":
                difference = math.remainder(difference, math.tau)
            position += (stamp - older.stamp) / (newer.stamp - older.stamp) * difference
        return leader.multiplier * position + leader.offset
