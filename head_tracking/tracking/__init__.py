"""Tracking: target estimator, servo models, tracking laws, trajectories."""

from head_tracking.tracking.clock_watch import ClockWatch
from head_tracking.tracking.error_statistics import ErrorStatistics, TrackingJudge
from head_tracking.tracking.estimator import (
    EstimatorParameters,
    TargetEstimator,
    Verdict,
)
from head_tracking.tracking.fictitious_target import FictitiousTarget, FictitiousTargetParameters
from head_tracking.tracking.following import FollowingWatch, stalled
from head_tracking.tracking.joint_readings import JointReading, JointReadings
from head_tracking.tracking.law import SpeedLimits, TrackingLaw
from head_tracking.tracking.laws import (
    LAWS,
    PositionLaw,
    PredictiveLaw,
    PredictiveLawParameters,
    SpeedLaw,
    SpeedLawParameters,
)
from head_tracking.tracking.learned import LearnedValue, Learning, LearningParameters, ServoValues
from head_tracking.tracking.setpoint import SetpointStream
from head_tracking.tracking.target import HeadBase, Refusal, Target, TargetPlacer
from head_tracking.tracking.target_state import (
    TargetState,
    TargetStateMachine,
    TargetStateParameters,
)
from head_tracking.tracking.trace import Sample, Trace
from head_tracking.tracking.trace_report import lag, picture, table
from head_tracking.tracking.tracker import (
    CAUTIOUS_SPEED,
    Tracker,
    TrackingStep,
)
from head_tracking.tracking.trajectory import (
    JointPoint,
    JointTrajectory,
    Tolerances,
    TrajectoryCode,
    TrajectoryError,
    TrajectoryParameters,
    Waypoint,
    checked_waypoints,
)

__all__ = [
    "CAUTIOUS_SPEED",
    "LAWS",
    "ClockWatch",
    "ErrorStatistics",
    "EstimatorParameters",
    "FictitiousTarget",
    "FictitiousTargetParameters",
    "FollowingWatch",
    "HeadBase",
    "JointPoint",
    "JointReading",
    "JointReadings",
    "JointTrajectory",
    "LearnedValue",
    "Learning",
    "LearningParameters",
    "PositionLaw",
    "PredictiveLaw",
    "PredictiveLawParameters",
    "Refusal",
    "Sample",
    "ServoValues",
    "SetpointStream",
    "SpeedLaw",
    "SpeedLawParameters",
    "SpeedLimits",
    "Target",
    "TargetEstimator",
    "TargetPlacer",
    "TargetState",
    "TargetStateMachine",
    "TargetStateParameters",
    "Tolerances",
    "Trace",
    "Tracker",
    "TrackingJudge",
    "TrackingLaw",
    "TrackingStep",
    "TrajectoryCode",
    "TrajectoryError",
    "TrajectoryParameters",
    "Verdict",
    "Waypoint",
    "checked_waypoints",
    "lag",
    "picture",
    "stalled",
    "table",
]
