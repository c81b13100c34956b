"""Simulated Dynamixel servos behind a serial port that any Dynamixel program can open."""

from head_tracking.simulation.answer import Answer, Line
from head_tracking.simulation.bus import Misfortune, SimulatedBus
from head_tracking.simulation.exceptions import (
    PortLinkError,
    SimulationError,
    UnknownServoError,
)
from head_tracking.simulation.faults import LINE_FAULTS, SENDING_FAULTS, SERVO_FAULTS, Fault, Faults
from head_tracking.simulation.oracle import Oracle, Taken
from head_tracking.simulation.protocol1 import (
    DamagedPacket,
    InstructionPacket,
    InstructionParser,
    StatusPacket,
)
from head_tracking.simulation.protocol2 import (
    DamagedPacket2,
    InstructionPacket2,
    InstructionParser2,
    StatusPacket2,
)
from head_tracking.simulation.servo import SimulatedServo
from head_tracking.simulation.simulated_joints import SimulatedJoints
from head_tracking.simulation.simulated_line import SimulatedClock, SimulatedLine
from head_tracking.simulation.simulated_port import SimulatedPort
from head_tracking.simulation.wire import Wire

__all__ = [
    "LINE_FAULTS",
    "SENDING_FAULTS",
    "SERVO_FAULTS",
    "Answer",
    "DamagedPacket",
    "DamagedPacket2",
    "Fault",
    "Faults",
    "InstructionPacket",
    "InstructionPacket2",
    "InstructionParser",
    "InstructionParser2",
    "Line",
    "Misfortune",
    "Oracle",
    "PortLinkError",
    "SimulatedBus",
    "SimulatedClock",
    "SimulatedJoints",
    "SimulatedLine",
    "SimulatedPort",
    "SimulatedServo",
    "SimulationError",
    "StatusPacket",
    "StatusPacket2",
    "Taken",
    "UnknownServoError",
    "Wire",
]
