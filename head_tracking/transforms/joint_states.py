"""Completes measured joint states by dependent joints and default positions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

from head_tracking.transforms.exceptions import RobotModelError
from head_tracking.transforms.robot_model import Joint, Mimic, RobotModel, resolved_leaders


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
    """Adds dependent joints and defaults to measured joints.

    Args:
        model: the robot.
        zeros: positions of joints that are not measured [rad or m].
        dependent_joints: joints that follow others, besides the mimic joints of the model.
        default_positions: the position of each other joint is 0, or the middle of its limits if 0
            is outside.

    Raises:
        RobotModelError: a joint of `zeros` or `dependent_joints` is not an independent joint.
    """

    def __init__(
        self,
        model: RobotModel,
        zeros: Mapping[str, float],
        dependent_joints: Mapping[str, Mimic] | None = None,
        *,
        default_positions: bool = False,
    ) -> None:
        dependent_joints = dependent_joints or {}
        _check_known(model, dependent_joints, "dependent_joints")
        mimics = {name: j.mimic for name, j in model.joints.items() if j.mimic is not None}
        self._leaders = resolved_leaders(model, mimics | dict(dependent_joints))
        independent = [joint for joint in model.joints.values() if joint.moves]
        independent = [joint for joint in independent if joint.name not in self._leaders]
        _check_known(model, zeros, "a default position", [joint.name for joint in independent])
        self._defaults = {name: JointState(position) for name, position in zeros.items()}
        if default_positions:
            for joint in independent:
                self._defaults.setdefault(joint.name, JointState(_default_position(joint)))

    def complete(self, measured: Mapping[str, JointSample]) -> dict[str, JointSample]:
        """Return the measured joints, the dependent joints, and the defaults of the others.

        A joint with neither measurement nor default is left out, and so are its dependent joints. A
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


def _check_known(
    model: RobotModel, names: Iterable[str], what: str, allowed: Iterable[str] | None = None
) -> None:
    possible = [joint.name for joint in model.joints.values() if joint.moves]
    possible = possible if allowed is None else list(allowed)
    for name in names:
        if name not in possible:
            raise RobotModelError(
                f"{what}: {name!r} is not an independent joint of {model.name!r}; those are: "
                f"{', '.join(possible) or 'none'}"
            )
