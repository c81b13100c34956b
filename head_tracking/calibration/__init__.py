"""Where the camera of a head really sits: measured by looking around a marker.

`Head.calibrate` measures it, `Calibration` keeps it in a file, and `calibrated` applies that file
to a robot's model.
"""

from head_tracking.calibration.geometry import Estimate
from head_tracking.calibration.result import Calibration, CalibrationFileError, calibrated, summary

__all__ = ["Calibration", "CalibrationFileError", "Estimate", "calibrated", "summary"]
