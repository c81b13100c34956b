"""Exact pointing: which joint positions put a camera's axis through a point."""

from head_tracking.gaze.head import ON_LIMIT, Gaze, GazeStatus, PanTiltHead, Sight
from head_tracking.gaze.pointing import (
    HeadCommand,
    Pointing,
    PointingParameters,
    PointingResult,
    together,
)

__all__ = [
    "ON_LIMIT",
    "Gaze",
    "GazeStatus",
    "HeadCommand",
    "PanTiltHead",
    "Pointing",
    "PointingParameters",
    "PointingResult",
    "Sight",
    "together",
]
