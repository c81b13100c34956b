"""What connects a frame to its parent: something fixed, a recorded motion, or a joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from head_tracking.transforms.chain import ConstantStep, PoseStep, Step, joint_steps
from head_tracking.transforms.history import JointHistory, TransformHistory
from head_tracking.transforms.joint import Joint, Mimic
from head_tracking.transforms.transform import Transform

AnyHistory: TypeAlias = JointHistory | TransformHistory


@dataclass(frozen=True, slots=True)
class StaticEdge:
    """A frame that never moves in its parent."""

    parent: str
    child: str
    transform: Transform
    history: None = None

    def steps(self, argument: int) -> tuple[Step, ...]:
        """From parent to child, as steps of a chain."""
        return (ConstantStep(self.transform),)


@dataclass(frozen=True, slots=True)
class SampledEdge:
    """A frame given by stamped transforms that somebody measured."""

    child: str
    history: TransformHistory

    @property
    def parent(self) -> str:
        """The parent of the newest sample; earlier it may have been another. Empty: unknown."""
        return self.history.newest[0] if self.history else ""

    def steps(self, argument: int) -> tuple[Step, ...]:
        """From parent to child, as steps of a chain."""
        return (PoseStep(argument),)


@dataclass(frozen=True, slots=True)
class JointEdge:
    """A link that a joint moves.

    The position is recorded and interpolated, not the transform: between two samples the link
    moves on the arc, as it really did.

    Attributes:
        joint: the joint that carries the link.
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

    def steps(self, argument: int) -> tuple[Step, ...]:
        """From parent to child, as steps of a chain."""
        return joint_steps(self.joint, self.leader, argument)


Edge: TypeAlias = StaticEdge | SampledEdge | JointEdge
