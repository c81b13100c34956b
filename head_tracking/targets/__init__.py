"""Sources of targets: frames, joints of skeletons, and a choice among several sources."""

from head_tracking.targets.frame_target import FrameTarget, FrameTargetParameters, StaleFrameError
from head_tracking.targets.mux import MuxParameters, SourceParameters, TargetMux, between
from head_tracking.targets.skeleton import SKELETON_JOINTS, skeleton_frame

__all__ = [
    "SKELETON_JOINTS",
    "FrameTarget",
    "FrameTargetParameters",
    "MuxParameters",
    "SourceParameters",
    "StaleFrameError",
    "TargetMux",
    "between",
    "skeleton_frame",
]
