"""Transforms between frames: a replacement for tf2 that computes the robot's own at lookup."""

from head_tracking.transforms.buffer import LARGEST_POSITION, TransformBuffer
from head_tracking.transforms.exceptions import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    RobotModelError,
    TimeoutException,
    TransformException,
)
from head_tracking.transforms.history import LATEST
from head_tracking.transforms.joint_states import JointSample, JointState, JointStates
from head_tracking.transforms.robot_model import (
    Joint,
    JointChain,
    JointLimits,
    JointType,
    Mimic,
    RobotModel,
)
from head_tracking.transforms.transform import (
    Rotation,
    StampedTransform,
    Transform,
    Vector3,
)
from head_tracking.transforms.urdf import load_robot_model, parse_robot_model, with_fixed_root

__all__ = [
    "LARGEST_POSITION",
    "LATEST",
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "Joint",
    "JointChain",
    "JointLimits",
    "JointSample",
    "JointState",
    "JointStates",
    "JointType",
    "LookupException",
    "Mimic",
    "RobotModel",
    "RobotModelError",
    "Rotation",
    "StampedTransform",
    "TimeoutException",
    "Transform",
    "TransformBuffer",
    "TransformException",
    "Vector3",
    "load_robot_model",
    "parse_robot_model",
    "with_fixed_root",
]
