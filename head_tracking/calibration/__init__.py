"""Calibration of the camera mounting and joint zeros of a head by what its camera sees.

`Head.calibrate` measures them, and `Calibration` has them: it is a file, and changes a robot model.
"""

from head_tracking.calibration.geometry import Estimate
from head_tracking.calibration.result import Calibration, CalibrationFileError, summary

__all__ = ["Calibration", "CalibrationFileError", "Estimate", "summary"]
