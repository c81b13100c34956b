"""Servo bus driver for Dynamixel and Feetech servos; see `ServoBus` and `BusThread`."""

from head_tracking.dynamixel.adapter import Adapter
from head_tracking.dynamixel.bus import ServoBus
from head_tracking.dynamixel.configuration import (
    BusSettings,
    EepromSettings,
    JointConfiguration,
    ServoCalibration,
    check_configuration,
)
from head_tracking.dynamixel.exceptions import (
    BusStoppedError,
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    DynamixelError,
    GoalError,
    PortBusyError,
    PortError,
    PortLostError,
    PortMissingError,
    ReplyTimeoutError,
    ServoError,
    ServoNotFoundError,
    StoppedError,
    TorqueError,
)
from head_tracking.dynamixel.models import ServoModel, servo_model
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.protocol import (
    describe_errors,
)
from head_tracking.dynamixel.requests import Epoch
from head_tracking.dynamixel.state import (
    BusEvent,
    BusReading,
    BusStatistics,
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
    "CommunicationError",
    "ConfigurationError",
    "CorruptReplyError",
    "DynamixelError",
    "DynamixelPort",
    "EepromSettings",
    "Epoch",
    "EventKind",
    "Goal",
    "GoalError",
    "Health",
    "JointConfiguration",
    "PortBusyError",
    "PortError",
    "PortLostError",
    "PortMissingError",
    "ReplyTimeoutError",
    "ServoBus",
    "ServoCalibration",
    "ServoError",
    "ServoModel",
    "ServoNotFoundError",
    "ServoState",
    "ServoStatistics",
    "StoppedError",
    "Symptom",
    "Torque",
    "TorqueError",
    "check_configuration",
    "describe_errors",
    "relax_servos",
    "servo_model",
]
