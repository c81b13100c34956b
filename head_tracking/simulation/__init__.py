"""Simulated Dynamixel and Feetech servos behind a serial port that any program can open."""

from head_tracking.simulation.bus import Answer, SimulatedBus
from head_tracking.simulation.faults import Fault, Faults
from head_tracking.simulation.models import SimulationError
from head_tracking.simulation.port import SimulatedPort
from head_tracking.simulation.serial_line import (
    Overlap,
    SerialLine,
    SimulatedClock,
    SimulatedLine,
    SteadyClock,
)
from head_tracking.simulation.servo import SimulatedServo, Write

__all__ = [
    "Answer",
    "Fault",
    "Faults",
    "Overlap",
    "SerialLine",
    "SimulatedBus",
    "SimulatedClock",
    "SimulatedLine",
    "SimulatedPort",
    "SimulatedServo",
    "SimulationError",
    "SteadyClock",
    "Write",
]
