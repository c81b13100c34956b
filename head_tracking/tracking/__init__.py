"""Following a moving target: placing it, the law that turns the head, and losing it."""

from head_tracking.tracking.error_statistics import ErrorStatistics
from head_tracking.tracking.fictitious_target import FictitiousTarget, FictitiousTargetParameters
from head_tracking.tracking.lost_target import (
    LostTargetParameters,
    LostTargetPolicy,
    TargetState,
)
from head_tracking.tracking.speed_law import SpeedLaw, SpeedLawParameters
from head_tracking.tracking.target import Target, TargetPlacer
from head_tracking.tracking.tracker import Tracker, TrackingStep

__all__ = [
    "ErrorStatistics",
    "FictitiousTarget",
    "FictitiousTargetParameters",
    "LostTargetParameters",
    "LostTargetPolicy",
    "SpeedLaw",
    "SpeedLawParameters",
    "Target",
    "TargetPlacer",
    "TargetState",
    "Tracker",
    "TrackingStep",
]
