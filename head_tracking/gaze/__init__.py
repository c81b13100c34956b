"""Exact pointing: which joint positions put a camera's axis through a point."""

from head_tracking.gaze.arrival import AT_GOAL, Arrival, at_goal
from head_tracking.gaze.pan_tilt_head import ON_LIMIT, Gaze, GazeStatus, PanTiltHead, Ray
from head_tracking.gaze.pointing import (
    HeadCommand,
    PointingParameters,
    PointingResult,
    together,
)

__all__ = [
    "AT_GOAL",
    "ON_LIMIT",
    "Arrival",
    "Gaze",
    "GazeStatus",
    "HeadCommand",
    "PanTiltHead",
    "PointingParameters",
    "PointingResult",
    "Ray",
    "at_goal",
    "together",
]
