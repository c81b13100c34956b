"""Servo bus driver for Dynamixel and Feetech servos; see `ServoBus` and `BusThread`."""

from head_tracking.dynamixel.adapter import Adapter
from head_tracking.dynamixel.bus import ServoBus
from head_tracking.dynamixel.configuration import (
    BusSettings,
    EepromSettings,
    JointConfiguration,
    ServoCalibration,
    check_configuration,
    fastest_speed,
)
from head_tracking.dynamixel.control_table import Register
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
    ReplyTimeoutError,
    ServoError,
    ServoNotFoundError,
    ServoSetupError,
    StoppedError,
    TorqueError,
)
from head_tracking.dynamixel.models import ServoModel, servo_model, servo_model_by_number
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.protocol import (
    ErrorBits,
    HardwareErrors,
    Status,
    describe_errors,
)
from head_tracking.dynamixel.reading import ReadGroup, ReadMethod
from head_tracking.dynamixel.requests import Epoch
from head_tracking.dynamixel.serial_port import serial_ports
from head_tracking.dynamixel.servo import Servo
from head_tracking.dynamixel.state import (
    BusEvent,
    BusReading,
    BusStatistics,
    CommandResult,
    EventKind,
    Goal,
    Health,
    ServoState,
    ServoStatistics,
    Symptom,
    Torque,
)
from head_tracking.dynamixel.thread import BusThread, BusTiming
from head_tracking.dynamixel.torque import relax_servos

__all__ = [
    "Adapter",
    "BusEvent",
    "BusReading",
    "BusSettings",
    "BusStatistics",
    "BusStoppedError",
    "BusThread",
    "BusTiming",
    "CommandResult",
    "CommunicationError",
    "ConfigurationError",
    "CorruptReplyError",
    "DynamixelError",
    "DynamixelPort",
    "EepromSettings",
    "Epoch",
    "ErrorBits",
    "EventKind",
    "Goal",
    "GoalError",
    "HardwareErrors",
    "Health",
    "JointConfiguration",
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
    "ReplyTimeoutError",
    "Servo",
    "ServoBus",
    "ServoCalibration",
    "ServoError",
    "ServoModel",
    "ServoNotFoundError",
    "ServoSetupError",
    "ServoState",
    "ServoStatistics",
    "Status",
    "StoppedError",
    "Symptom",
    "Torque",
    "TorqueError",
    "check_configuration",
    "describe_errors",
    "fastest_speed",
    "relax_servos",
    "serial_ports",
    "servo_model",
    "servo_model_by_number",
]
