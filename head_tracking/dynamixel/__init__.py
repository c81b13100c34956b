"""Servo bus driver for Dynamixel servos; see `ServoBus` and `BusThread`."""

from head_tracking.dynamixel.adapter import Adapter
from head_tracking.dynamixel.bus_thread import BusThread, BusTiming, CycleSchedule
from head_tracking.dynamixel.buses import Buses
from head_tracking.dynamixel.command import CommandResult, Goal, Torque
from head_tracking.dynamixel.configuration import JointConfiguration, check_configuration
from head_tracking.dynamixel.control_table import Access, Block, ControlTable, Memory, Register
from head_tracking.dynamixel.dynamixel_port import DynamixelPort
from head_tracking.dynamixel.eeprom import EepromSettings
from head_tracking.dynamixel.exceptions import (
    BusStoppedError,
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    DynamixelError,
    GoalError,
    NotConnectedError,
    PortBusyError,
    PortError,
    PortLostError,
    PortMissingError,
    PortPermissionError,
    RangeError,
    RegisterRefusedError,
    ReplyTimeoutError,
    ServoError,
    ServoModeError,
    ServoNotFoundError,
    TorqueError,
    UnknownRegisterError,
    WrongModelError,
)
from head_tracking.dynamixel.identification import ServoIdentity
from head_tracking.dynamixel.models import ServoModel, servo_model, servo_model_by_number
from head_tracking.dynamixel.mount import ServoMount
from head_tracking.dynamixel.port import ReadGroup, ReadMethod, Reply, ServoPort
from head_tracking.dynamixel.protocol import (
    ErrorBits,
    HardwareErrors,
    Instruction,
    XL320Errors,
    describe_errors,
)
from head_tracking.dynamixel.sdk import serial_ports
from head_tracking.dynamixel.servo_bus import ServoBus
from head_tracking.dynamixel.servo_state import (
    BusEvent,
    BusReading,
    BusStatistics,
    EventKind,
    Health,
    ServoState,
    ServoStatistics,
)
from head_tracking.dynamixel.settings import BusSettings

__all__ = [
    "Access",
    "Adapter",
    "Block",
    "BusEvent",
    "BusReading",
    "BusSettings",
    "BusStatistics",
    "BusStoppedError",
    "BusThread",
    "BusTiming",
    "Buses",
    "CommandResult",
    "CommunicationError",
    "ConfigurationError",
    "ControlTable",
    "CorruptReplyError",
    "CycleSchedule",
    "DynamixelError",
    "DynamixelPort",
    "EepromSettings",
    "ErrorBits",
    "EventKind",
    "Goal",
    "GoalError",
    "HardwareErrors",
    "Health",
    "Instruction",
    "JointConfiguration",
    "Memory",
    "NotConnectedError",
    "PortBusyError",
    "PortError",
    "PortLostError",
    "PortMissingError",
    "PortPermissionError",
    "RangeError",
    "ReadGroup",
    "ReadMethod",
    "Register",
    "RegisterRefusedError",
    "Reply",
    "ReplyTimeoutError",
    "ServoBus",
    "ServoError",
    "ServoIdentity",
    "ServoModeError",
    "ServoModel",
    "ServoMount",
    "ServoNotFoundError",
    "ServoPort",
    "ServoState",
    "ServoStatistics",
    "Torque",
    "TorqueError",
    "UnknownRegisterError",
    "WrongModelError",
    "XL320Errors",
    "check_configuration",
    "describe_errors",
    "serial_ports",
    "servo_model",
    "servo_model_by_number",
]
