"""What connects a frame to its parent: something fixed, a recorded motion, or a joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from head_tracking.transforms.exceptions import LookupException
from head_tracking.transforms.history import JointHistory, TransformHistory
from head_tracking.transforms.joint import Joint, Mimic
from head_tracking.transforms.transform import Transform

Positions = Mapping[str, float]


class Edge(Protocol):
    """A connection of the frame `child` to the frame `parent`.

    `given` holds joints that are taken to stand at a given position [rad or m] at any time,
    instead of at the recorded one.
    """

    @property
    def parent(self) -> str:
        """The frame that carries the other."""

    @property
    def child(self) -> str:
        """The frame that is carried."""

    def span(self, given: Positions) -> tuple[int, int] | None:
        """The oldest and newest stamp known [ns]; None if the transform holds at any time.

        Raises:
            LookupException: it changes over time, and nothing is known yet.
        """

    def at(self, stamp: int, given: Positions) -> Transform:
        """`T_parent_child` at `stamp` [ns], which must lie within the span."""


@dataclass(frozen=True, slots=True)
class StaticEdge:
    """An edge that never changes."""

    parent: str
    child: str
    transform: Transform

    def span(self, given: Positions) -> None:
        """None: the transform holds at any time."""

    def at(self, stamp: int, given: Positions) -> Transform:
        """The transform."""
        return self.transform


@dataclass(frozen=True, slots=True)
class SampledEdge:
    """An edge given by stamped transforms that somebody measured."""

    parent: str
    child: str
    history: TransformHistory

    def span(self, given: Positions) -> tuple[int, int]:
        """The recorded time [ns]."""
        return self.history.oldest, self.history.latest

    def at(self, stamp: int, given: Positions) -> Transform:
        """The transform at `stamp` [ns], interpolated."""
        return self.history.at(stamp)


@dataclass(frozen=True, slots=True)
class JointEdge:
    """An edge given by a joint of the model and the history of the joint that decides it.

    The position is interpolated, not the transform: between two samples the child moves on
    the arc, as it really did.

    Attributes:
        joint: the joint between the two frames.
        leader: the joint that is measured: this one, or the one it mimics.
        history: the measured positions of the leader.
    """

    joint: Joint
    leader: Mimic
    history: JointHistory

    @property
    def parent(self) -> str:
        """The link that carries the joint."""
        return self.joint.parent

    @property
    def child(self) -> str:
        """The link that the joint moves."""
        return self.joint.child

    def span(self, given: Positions) -> tuple[int, int] | None:
        """The recorded time [ns]; None for a given position.

        Raises:
            LookupException: the joint has no position yet.
        """
        if self.leader.joint in given:
            return None
        if not self.history:
            raise LookupException(
                f"the joint {self.leader.joint!r} between {self.parent!r} and {self.child!r} has "
                "no position yet; is it in joint_states?"
            )
        return self.history.oldest, self.history.latest

    def at(self, stamp: int, given: Positions) -> Transform:
        """The transform at `stamp` [ns], the joint's position interpolated."""
        position = given.get(self.leader.joint)
        if position is None:
            position = self.history.at(stamp)
        return self.joint.transform(self.leader.multiplier * position + self.leader.offset)


def product(edges: Sequence[Edge], stamp: int, given: Positions) -> Transform:
    """`T_top_bottom` at `stamp` [ns] along a chain of edges, topmost first."""
    result = Transform.identity()
    for edge in edges:
        result = result @ edge.at(stamp, given)
    return result
