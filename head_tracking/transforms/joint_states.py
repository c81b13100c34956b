"""Completes measured joint states by mimic joints and default positions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from head_tracking.transforms.exceptions import RobotModelError
from head_tracking.transforms.robot_model import Joint, RobotModel


class JointSample(Protocol):
    """The state of a joint; see `JointState`."""

    @property
    def position(self) -> float:
        """[rad or m]."""

    @property
    def velocity(self) -> float:
        """[rad/s or m/s]."""

    @property
    def effort(self) -> float:
        """[N m or N]; NaN: unknown."""


@dataclass(frozen=True, slots=True)
class JointState:
    """The state of one joint.

    Attributes:
        position: [rad or m].
        velocity: [rad/s or m/s].
        effort: [N m or N]; NaN: unknown.
    """

    position: float
    velocity: float = 0.0
    effort: float = math.nan


class JointStates:
    """Adds mimic joints and defaults to measured joints.

    Args:
        model: the robot.
        zeros: positions of joints that are not measured [rad or m].
        default_positions: the position of each other joint is 0, or the middle of its limits if 0
            is outside.

    Raises:
        RobotModelError: a joint of `zeros` is not an independent joint.
    """

    def __init__(
        self,
        model: RobotModel,
        zeros: Mapping[str, float],
        *,
        default_positions: bool = False,
    ) -> None:
        mimics = [name for name, joint in model.joints.items() if joint.mimic is not None]
        self._leaders = {name: model.leader(name) for name in mimics}
        independent = model.independent_joints
        for name in zeros.keys() - set(independent):
            raise RobotModelError(
                f"a default position: {name!r} is not an independent joint of {model.name!r}; "
                f"those are: {', '.join(independent) or 'none'}"
            )
        self._defaults = {name: JointState(position) for name, position in zeros.items()}
        if default_positions:
            for name in independent:
                position = _default_position(model.joints[name])
                self._defaults.setdefault(name, JointState(position))

    def complete(self, measured: Mapping[str, JointSample]) -> dict[str, JointSample]:
        """Return the measured joints, the mimic joints, and the defaults of the others.

        A joint with neither measurement nor default is left out, and so are those that mimic it. A
        joint that was measured before has no default.
        """
        for name in measured:
            self._defaults.pop(name, None)
        known: dict[str, JointSample] = {**self._defaults, **measured}
        for name, leader in self._leaders.items():
            state = known.get(leader.joint)
            if state is not None and name not in measured:
                known[name] = JointState(
                    leader.multiplier * state.position + leader.offset,
                    leader.multiplier * state.velocity,
                )
        return known


def _default_position(joint: Joint) -> float:
    limits = joint.limits
    return 0.0 if limits.contains(0.0) else 0.5 * (limits.lower + limits.upper)
