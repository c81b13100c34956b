"""Simulated Dynamixel servos behind a serial port that any Dynamixel program can open."""

from head_tracking.simulation.bus import Answer, Line, SimulatedBus
from head_tracking.simulation.exceptions import (
    PortLinkError,
    SimulationError,
    UnknownServoError,
)
from head_tracking.simulation.protocol1 import (
    DamagedPacket,
    InstructionPacket,
    InstructionParser,
    StatusPacket,
)
from head_tracking.simulation.servo import SimulatedServo
from head_tracking.simulation.simulated_joints import SimulatedJoints
from head_tracking.simulation.simulated_port import SimulatedPort

__all__ = [
    "Answer",
    "DamagedPacket",
    "InstructionPacket",
    "InstructionParser",
    "Line",
    "PortLinkError",
    "SimulatedBus",
    "SimulatedJoints",
    "SimulatedPort",
    "SimulatedServo",
    "SimulationError",
    "StatusPacket",
    "UnknownServoError",
]
