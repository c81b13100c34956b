"""Feetech servos for the servo bus of `head_tracking.dynamixel`: their tables and their protocol.

A Feetech servo is a model like any other: port, cycle, faults and tools are those of the Dynamixel
driver. Files in `tables/` describe the models, in the same format.
"""

from head_tracking.feetech.protocol import FeetechErrors

__all__ = ["FeetechErrors"]
