"""Completing measured joint states by what the model and a person say of the other joints."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

from head_tracking.transforms.exceptions import RobotModelError
from head_tracking.transforms.robot_model import Joint, Mimic, RobotModel, resolved_leaders


class JointSample(Protocol):
    """A joint as somebody has measured or stated it; see `JointState`."""

    @property
    def position(self) -> float:
        """[rad or m]."""

    @property
    def velocity(self) -> float:
        """[rad/s or m/s]."""

    @property
    def effort(self) -> float:
        """[N m or N]; NaN: not known."""


@dataclass(frozen=True, slots=True)
class JointState:
    """One joint at one moment.

    Attributes:
        position: [rad or m].
        velocity: [rad/s or m/s].
        effort: [N m or N]; NaN: not known.
    """

    position: float
    velocity: float = 0.0
    effort: float = math.nan


class JointStates:
    """Adds joints that follow others, and stated defaults, to measured joints; invents nothing.

    Args:
        model: the robot.
        zeros: positions of joints that nobody measures [rad or m], as stated by a person.
        dependent_joints: joints that follow others besides those that mimic in the model.
        default_positions: joints that nobody measures stand at 0, or in the middle of their
            limits if 0 is outside.

    Raises:
        RobotModelError: a default or a rule for a joint that is not there or follows another.
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
        _check_known(model, dependent_joints, "a rule")
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
        """The measured joints, those that follow them, and the defaults of the rest.

        A joint that is neither measured nor stated is left out, and so is what follows it. One
        that was measured ever before has no default any more.
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
                f"{what} is stated for {name!r}, which is no joint of its own in "
                f"{model.name!r}; those are: {', '.join(possible) or 'none'}"
            )
