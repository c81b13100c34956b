"""A transform buffer as plain as can be, to compare the real one with. Matrices, no cleverness."""

from __future__ import annotations

import math

import numpy as np
from tf2_model import between

from head_tracking.transforms import RobotModel, Transform

Matrix = np.ndarray


class Unknown(Exception):
    pass


class NaiveBuffer:
    """Joints as (stamp, position) lists, frames as (stamp, parent, transform) lists."""

    def __init__(self, cache_time: int = 10_000_000_000) -> None:
        self.cache_time = cache_time
        self.samples: dict[str, list[tuple[int, str, Transform]]] = {}
        self.joints: dict[str, list[tuple[int, float]]] = {}
        self.model: RobotModel | None = None

    def set_joint(self, stamp: int, name: str, position: float) -> None:
        self._put(self.joints.setdefault(name, []), (stamp, position))

    def set_transform(self, stamp: int, parent: str, child: str, transform: Transform) -> None:
        self._put(self.samples.setdefault(child, []), (stamp, parent, transform))

    def _put(self, samples: list, sample: tuple) -> None:
        """As tf2: what is too old goes before the new sample comes."""
        newest = max((s[0] for s in samples), default=sample[0])
        samples[:] = [s for s in samples if s[0] >= newest - self.cache_time]
        if sample[0] >= newest - self.cache_time:
            samples.append(sample)
            samples.sort(key=lambda s: s[0])

    def matrix(self, target: str, source: str, stamp: int) -> Matrix:
        """T_target_source at a stamp other than 0."""
        above_target, above_source = self._above(target, stamp), self._above(source, stamp)
        for frame in above_source:
            if frame in above_target:
                return np.linalg.inv(above_target[frame]) @ above_source[frame]
        raise Unknown

    def _above(self, frame: str, stamp: int) -> dict[str, Matrix]:
        """For the frame and all that carry it: T_ancestor_frame."""
        result = {frame: np.eye(4)}
        while True:
            try:
                edge = self._edge(frame, stamp)
            except Unknown:
                return result
            if edge is None or edge[0] in result:
                return result
            parent, matrix = edge
            result[parent] = matrix @ result[frame]
            frame = parent

    def _edge(self, child: str, stamp: int) -> tuple[str, Matrix] | None:
        if self.model is not None and child in self.model.children_of_joints:
            joint = self.model.parent_joint(child)
            position = 0.0
            if joint.moves:
                leader = self.model.leader(joint.name)
                position = leader.multiplier * self._joint(leader.joint, stamp) + leader.offset
            return joint.parent, joint.transform(position).as_matrix()
        if child not in self.samples:
            return None
        before, after, ratio = self._around(self.samples[child], stamp)
        if before[1] != after[1]:
            return before[1], before[2].as_matrix()
        return before[1], between(before[2], after[2], ratio)

    def _joint(self, name: str, stamp: int) -> float:
        before, after, ratio = self._around(self.joints.get(name, []), stamp)
        difference = after[1] - before[1]
        if self.model is not None and self.model.joints[name].type == "continuous":
            difference = math.remainder(difference, math.tau)
        return before[1] + ratio * difference

    def _around(self, samples: list, stamp: int) -> tuple[tuple, tuple, float]:
        if not samples or not samples[0][0] <= stamp <= samples[-1][0]:
            raise Unknown
        if stamp == samples[-1][0]:
            return samples[-1], samples[-1], 0.0
        if stamp == samples[0][0]:
            return samples[0], samples[0], 0.0
        before = [s for s in samples if s[0] <= stamp][-1]
        after = next(s for s in samples if s[0] > stamp)
        return before, after, (stamp - before[0]) / (after[0] - before[0])
