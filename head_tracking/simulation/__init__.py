"""Simulated Dynamixel and Feetech servos behind a serial port that any program can open."""

from head_tracking.simulation.bus import Answer, SimulatedBus
from head_tracking.simulation.exceptions import PortLinkError, SimulationError, UnknownServoError
from head_tracking.simulation.faults import LINE_FAULTS, SERVO_FAULTS, Fault, Faults
from head_tracking.simulation.port import SimulatedJoints, SimulatedPort, mounted_servos
from head_tracking.simulation.serial_line import (
    Overlap,
    SerialLine,
    SimulatedClock,
    SimulatedLine,
)
from head_tracking.simulation.servo import SimulatedServo
from head_tracking.simulation.write_log import Write, WriteLog

__all__ = [
    "LINE_FAULTS",
    "SERVO_FAULTS",
    "Answer",
    "Fault",
    "Faults",
    "Overlap",
    "PortLinkError",
    "SerialLine",
    "SimulatedBus",
    "SimulatedClock",
    "SimulatedJoints",
    "SimulatedLine",
    "SimulatedPort",
    "SimulatedServo",
    "SimulationError",
    "UnknownServoError",
    "Write",
    "WriteLog",
    "mounted_servos",
]
