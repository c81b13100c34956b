"""The parameters of the nodes that turn a head."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from head_tracking.gaze import PointingParameters
from head_tracking.gaze.head_parameters import HeadParameters
from head_tracking.parameters import parameter
from head_tracking.tracking import (
    LAWS,
    EstimatorParameters,
    LearningParameters,
    SpeedLimits,
    TargetStateParameters,
    TrajectoryParameters,
)


@dataclass(frozen=True, slots=True)
class DriveParameters:
    """What drives the joints."""

    command_interface: str = parameter(
        "joint_commands",
        "What drives the joints: servo_bus, by joint_commands; or a joint_trajectory_controller "
        "of the robot, by joint_trajectory. A head of the latter cannot be relaxed by `stop`.",
        choices=("joint_commands", "joint_trajectory"),
        fixed=True,
    )
    command_topic: str = parameter(
        "head_controller/joint_trajectory",
        "The topic of the joint_trajectory_controller.",
        fixed=True,
        ros_name=True,
    )
    time_from_start: float = parameter(
        0.0,
        "Time that the joint_trajectory_controller has for each point; 0: at once, for a "
        "controller that starts every trajectory at the measured position (the usual one does).",
        unit="s",
        minimum=0.0,
        maximum=1.0,
        fixed=True,
    )


@dataclass(frozen=True, slots=True)
class HeadTrackerParameters:
    """The rate and the law."""

    rate: float = parameter(
        50.0, "Commands per second.", unit="Hz", minimum=1.0, maximum=200.0, fixed=True
    )
    law: str = parameter(
        "predictive",
        "The tracking law: "
        + "; ".join(f"{name}: {law.description}" for name, law in LAWS.items()),
        choices=tuple(LAWS),
    )


@dataclass(frozen=True, slots=True)
class PointHeadParameters:
    """The names of the actions."""

    controller_name: str = parameter(
        "",
        "Namespace of the actions and of joint_trajectory: head_controller for clients of TIAGo, "
        "head_traj_controller for clients of PR2. Empty: the node's name.",
        fixed=True,
        ros_name=True,
    )


HEAD_NODES: Final[Mapping[str, tuple[type, ...]]] = {
    "point_head": (
        HeadParameters, DriveParameters, PointHeadParameters, PointingParameters,
        TrajectoryParameters,
    ),
    "head_tracker": (
        HeadParameters, DriveParameters, HeadTrackerParameters, SpeedLimits,
        *(law.Parameters for law in LAWS.values()),
        EstimatorParameters, TargetStateParameters, LearningParameters,
    ),
}  # fmt: skip
"""The classes of parameters that each node declares."""
