"""Following a moving target: placing it, the law that turns the head, and losing it."""

from head_tracking.tracking.error_statistics import ErrorStatistics
from head_tracking.tracking.fictitious_target import FictitiousTarget, FictitiousTargetParameters
from head_tracking.tracking.lost_target import (
    LostTargetParameters,
    LostTargetPolicy,
    TargetState,
)
from head_tracking.tracking.target import Target, TargetPlacer

__all__ = [
    "ErrorStatistics",
    "FictitiousTarget",
    "FictitiousTargetParameters",
    "LostTargetParameters",
    "LostTargetPolicy",
    "Target",
    "TargetPlacer",
    "TargetState",
]
