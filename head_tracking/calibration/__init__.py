"""Calibration of the camera mounting and joint zeros of a head by what its camera sees.

`Head.calibrate` measures them, `Calibration` is the file format, and `calibrated` applies a file to
a robot model.
"""

from head_tracking.calibration.geometry import Estimate
from head_tracking.calibration.result import Calibration, CalibrationFileError, calibrated, summary

__all__ = ["Calibration", "CalibrationFileError", "Estimate", "calibrated", "summary"]
