"""The laws by their names."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from head_tracking.gaze import PanTiltHead
from head_tracking.tracking.law import TrackingLaw
from head_tracking.tracking.law_parameters import LawParameters
from head_tracking.tracking.position_law import PositionLaw
from head_tracking.tracking.predictive_law import PredictiveLaw
from head_tracking.tracking.speed_law import SpeedLaw

LAWS: Mapping[str, Callable[[PanTiltHead, float, LawParameters], TrackingLaw]] = {
    "predictive": PredictiveLaw,
    "speed": SpeedLaw,
    "position": PositionLaw,
}
"""Each takes the head, the time between two commands [s] and the parameters."""
