"""Following a moving target: estimate it, place it, turn the head to it, and lose it."""

from head_tracking.tracking.error_statistics import ErrorStatistics
from head_tracking.tracking.estimator import (
    EstimatorParameters,
    TargetEstimate,
    TargetEstimator,
    Verdict,
)
from head_tracking.tracking.fictitious_target import FictitiousTarget, FictitiousTargetParameters
from head_tracking.tracking.law import JointReading, TrackingLaw
from head_tracking.tracking.law_parameters import (
    LawParameters,
    PredictiveLawParameters,
    SpeedLawParameters,
    SpeedLimits,
)
from head_tracking.tracking.laws import LAWS
from head_tracking.tracking.life_cycle import LifeCycle, LifeCycleParameters, TargetState
from head_tracking.tracking.position_law import PositionLaw
from head_tracking.tracking.predictive_law import PredictiveLaw
from head_tracking.tracking.recording import Recording, Sample
from head_tracking.tracking.report import lag, picture, table
from head_tracking.tracking.speed_law import SpeedLaw
from head_tracking.tracking.target import Target, TargetPlacer

from head_tracking.tracking.track_record import TrackRecord
from head_tracking.tracking.tracker import Delays, Tracker, TrackingStep

__all__ = [
    "LAWS",
    "Delays",
    "ErrorStatistics",
    "EstimatorParameters",
    "FictitiousTarget",
    "FictitiousTargetParameters",
    "JointReading",
    "LawParameters",
    "LifeCycle",
    "LifeCycleParameters",
    "PositionLaw",
    "PredictiveLaw",
    "PredictiveLawParameters",
    "Recording",
    "Sample",
    "SpeedLaw",
    "SpeedLawParameters",
    "SpeedLimits",
    "Target",
    "TargetEstimate",
    "TargetEstimator",
    "TargetPlacer",
    "TargetState",
    "TrackRecord",
    "Tracker",
    "TrackingLaw",
    "TrackingStep",
    "Verdict",
    "lag",
    "picture",
    "table",
]
