"""Completing measured joint states by what the model says of the other joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from head_tracking.transforms.exceptions import RobotModelError
from head_tracking.transforms.robot_model import RobotModel


@dataclass(frozen=True, slots=True)
class JointState:
    """One joint at one moment.

    Attributes:
        position: [rad or m].
        velocity: [rad/s or m/s].
        effort: in whatever unit its source gives.
    """

    position: float
    velocity: float = 0.0
    effort: float = 0.0


class JointStates:
    """Adds mimic joints and stated defaults to measured joints; invents nothing.

    Args:
        model: the robot.
        zeros: positions of joints that nobody measures [rad or m], as stated by a person.

    Raises:
        RobotModelError: a default for a joint that is not there or that follows another.
    """

    def __init__(self, model: RobotModel, zeros: Mapping[str, float]) -> None:
        for name in zeros:
            if name not in model.independent_joints:
                raise RobotModelError(
                    f"a default position is stated for {name!r}, which is no joint of its own in "
                    f"{model.name!r}; those are: {', '.join(model.independent_joints) or 'none'}"
                )
        self._model = model
        self._defaults = {name: JointState(position) for name, position in zeros.items()}

    def complete(self, measured: Mapping[str, JointState]) -> dict[str, JointState]:
        """The measured joints, those that follow them, and the stated defaults of the rest.

        A joint that is neither measured nor stated is left out, and so is what follows it.
        """
        known = self._defaults | dict(measured)
        for joint in self._model.joints.values():
            if joint.mimic is None or joint.name in measured:
                continue
            leader = self._model.leader(joint.name)
            state = known.get(leader.joint)
            if state is not None:
                known[joint.name] = JointState(
                    leader.multiplier * state.position + leader.offset,
                    leader.multiplier * state.velocity,
                )
        return known
