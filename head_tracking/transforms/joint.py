"""A joint of a robot model: where it is, how it moves and how far."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from head_tracking.transforms.rotation import Rotation, Vector3
from head_tracking.transforms.transform import Transform


class JointType(StrEnum):
    """The joint types of URDF that one number or none describes."""

    FIXED = "fixed"
    REVOLUTE = "revolute"
    CONTINUOUS = "continuous"
    PRISMATIC = "prismatic"


@dataclass(frozen=True, slots=True)
class JointLimits:
    """How far, fast and hard a joint may move.

    Attributes:
        lower: smallest position [rad or m]; -inf where there is none.
        upper: largest position [rad or m]; inf where there is none.
        velocity: largest speed [rad/s or m/s]; inf where none is given.
        effort: largest effort [N m or N]; inf where none is given.
    """

    lower: float = float("-inf")
    upper: float = float("inf")
    velocity: float = float("inf")
    effort: float = float("inf")

    def clamp(self, position: float) -> float:
        """The allowed position nearest to `position`."""
        return min(max(position, self.lower), self.upper)

    def contains(self, position: float, tolerance: float = 0.0) -> bool:
        """Whether `position` is allowed, give or take `tolerance`."""
        return self.lower - tolerance <= position <= self.upper + tolerance

    def narrowed(self, lower: float, upper: float) -> JointLimits:
        """These limits, and not beyond `lower` and `upper` either.

        Raises:
            ValueError: nothing would be left.
        """
        narrowed = JointLimits(
            max(self.lower, lower), min(self.upper, upper), self.velocity, self.effort
        )
        if not narrowed.lower < narrowed.upper:
            raise ValueError(
                f"the limits {self.lower:.3f} to {self.upper:.3f} and {lower:.3f} to {upper:.3f} "
                "have nothing in common; widen one of them"
            )
        return narrowed


@dataclass(frozen=True, slots=True)
class Mimic:
    """A joint that follows another: position = multiplier * (the other's position) + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint between two links, as in URDF.

    Attributes:
        name: unique in its model.
        type: fixed, revolute, continuous or prismatic.
        parent: the link that carries the joint.
        child: the link that the joint moves.
        origin: takes points from the joint's frame (the child at position 0) into the parent.
        axis: unit vector in the joint's frame, along or about which the child moves.
        limits: how far, fast and hard.
        mimic: the joint that this one follows, if any.
    """

    name: str
    type: JointType
    parent: str
    child: str
    origin: Transform
    axis: Vector3 = (1.0, 0.0, 0.0)
    limits: JointLimits = JointLimits()
    mimic: Mimic | None = None

    @property
    def moves(self) -> bool:
        """Whether the joint has a position at all."""
        return self.type is not JointType.FIXED

    def motion(self, position: float) -> Transform:
        """Takes points from the child into the joint's frame, at `position` [rad or m]."""
        if self.type is JointType.PRISMATIC:
            x, y, z = self.axis
            return Transform((position * x, position * y, position * z), Rotation.identity())
        if self.type is JointType.FIXED:
            return Transform.identity()
        return Transform((0.0, 0.0, 0.0), Rotation.from_axis_angle(self.axis, position))

    def transform(self, position: float) -> Transform:
        """Takes points from the child into the parent, at `position` [rad or m]."""
        return self.origin @ self.motion(position)
