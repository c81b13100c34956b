"""Values that the bus accepts and returns: goals, states, events, counters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, IntFlag
from typing import NamedTuple

from head_tracking.dynamixel.adapter import Adapter
from head_tracking.dynamixel.exceptions import GoalError
from head_tracking.dynamixel.protocol import NO_ERROR


class Torque(Enum):
    """Why a servo holds or does not hold its position."""

    OFF_UNTIL_COMMANDED = "relaxed; the first command switches torque on"
    OFF_ON_REQUEST = "relaxed on request; commands are refused until torque_enable is true"
    OFF_TO_COOL = "relaxed to cool down; commands are refused until it is no longer warm"
    OFF_BY_FAULT = "shut down by itself; commands are refused: find out why, then call recover"
    OFF_STOPPED = "stopped on request; commands are refused until its start is called"
    ON = "torque on"

    @property
    def refuses(self) -> bool:
        """Whether commands are refused."""
        return self not in (Torque.ON, Torque.OFF_UNTIL_COMMANDED)


class Goal(NamedTuple):
    """A goal position in rad, and the speed in rad/s; None: the joint's own speed."""

    position: float
    speed: float | None = None


class CommandResult(NamedTuple):
    """The result of an accepted command."""

    goals: Mapping[str, Goal]  # accepted goal by joint
    clamped: Sequence[str]  # joints whose position was moved to a limit
    # Joints that accept no goals now, and why; their goals were dropped.
    left_out: Mapping[str, str]


def check_speed(joint_name: str, speed: float) -> None:
    """Raise GoalError for a speed that is not finite or not above 0."""
    if not (math.isfinite(speed) and speed > 0.0):
        raise GoalError(
            f"{joint_name}: speed {speed} rad/s refused; it must be finite and above 0. To stop a "
            "joint, hold it"
        )


class Health(Enum):
    """State of a servo, for diagnostics."""

    UNKNOWN = "not found yet"
    PRESENT = "present"
    STALE = "stale: no answer since the last one"
    LOST = "lost: it does not answer"
    FAULTED = "faulted: it has shut itself down"
    STOPPED = "stopped on request"


class ServoState(NamedTuple):
    """Measured state of one joint; of two servos, that of the first one that answered."""

    stamp: int  # time of the measurement, ns, on the clock of the bus
    position: float  # joint position, rad
    velocity: float  # joint velocity, rad/s
    goal: float | None  # goal position, rad; None while relaxed

    @property
    def effort(self) -> float:
        """NaN: servos do not measure torque in N m."""
        return math.nan


class EventKind(Enum):
    """Kinds of events."""

    LOST = "lost"
    RETURNED = "returned"
    UNUSABLE = "unusable"
    TORQUE_ON = "torque on"
    TORQUE_OFF = "torque off"
    TORQUE_FAILED = "torque failed"
    TORQUE_LOST = "torque lost"
    FAULTED = "faulted"
    ALARM = "alarm"
    RECOVERED = "recovered"
    RESTING = "resting"
    COOLED = "cooled"
    HELD = "held"
    SYMPTOM = "symptom"
    CLEARED = "cleared"
    STOPPED = "stopped"
    PORT_LOST = "port lost"
    PORT_RETURNED = "port returned"


class Symptom(Enum):
    """Faults that the diagnosis finds, besides the servo's own error bits."""

    TORQUE_LOST = "torque lost"
    BLOCKED = "blocked"
    IDLE = "does not drive"
    WEAK = "weak"
    OVERRULED = "overruled"
    TRIPPED = "watchdog tripped"
    MODE = "wrong mode"
    AWAY = "moves away"
    SLOW = "slow"
    FROZEN = "encoder frozen"
    JUMP = "encoder jumps"
    APART = "servos disagree"
    SWAPPED = "swapped"
    SUPPLY = "supply low"
    SAG = "supply gives way"
    WARM = "heats up"
    LINE = "line disturbed"

    @property
    def stuck(self) -> bool:
        """Whether the joint cannot reach its goals."""
        return self in (Symptom.TORQUE_LOST, Symptom.BLOCKED, Symptom.IDLE, Symptom.MODE)

    @property
    def serious(self) -> bool:
        """Whether the servo does not follow its goals, or its measurements are wrong."""
        return self not in (Symptom.SUPPLY, Symptom.SAG, Symptom.WARM, Symptom.LINE)


@dataclass(frozen=True, slots=True)
class BusEvent:
    """An event on the bus."""

    kind: EventKind
    joint_name: str  # the joint; empty for the port
    text: str  # one sentence for the log
    stuck: bool = False  # whether the joint cannot reach its goals any more
    repeated: bool = False  # whether it has happened twice in a short time; the log leaves it out


class BusReading(NamedTuple):
    """Result of one bus cycle."""

    # Measurements of this cycle by joint name; joints that did not answer are absent.
    states: Mapping[str, ServoState]
    events: tuple[BusEvent, ...]  # events since the previous reading, in order
    stamp: int  # mean of the stamps of the states, ns; 0: there are none


@dataclass(slots=True)
class Counters:
    """Results of the transactions with one servo."""

    replies: int = 0  # successful transactions
    retries: int = 0  # repeated transactions
    timeouts: int = 0  # attempts without a reply
    corrupt: int = 0  # attempts with a damaged reply

    @property
    def failed(self) -> int:
        """Number of attempts without a usable reply."""
        return self.timeouts + self.corrupt


@dataclass(frozen=True, slots=True)
class ServoStatistics:
    """Counters and state of one servo."""

    joint_name: str
    id: int
    counters: Counters
    controller: str = ""  # prefix of its joint's services
    model: str = ""  # name of the configured model
    firmware_version: int | None = None  # None before the servo was found
    health: Health = Health.PRESENT
    errors: IntFlag = NO_ERROR  # its errors, as read last
    last_stamp: int | None = None  # time of the last measurement, ns; None: none
    temperature: float = 0.0  # degrees Celsius, as read last
    voltage: float = 0.0  # supply, V, as read last
    load: float = 0.0  # -1 to 1 of full torque, as read last
    position: float = 0.0  # of the joint, rad, as read last
    velocity: float = 0.0  # of the joint, rad/s, as read last
    torque: str = ""  # why it holds or does not hold its position
    # Faults that the diagnosis has found, a sentence each.
    symptoms: Mapping[Symptom, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class BusStatistics:
    """Counters of a bus."""

    cycles: int
    refused_commands: int  # commands that raised GoalError
    clamped_commands: int  # commands with at least one position moved to a limit
    # One entry for each servo, in the order of the configuration.
    servos: tuple[ServoStatistics, ...]
    connected: bool = True  # whether the port is open
    port_losses: int = 0  # how often the port was lost
    adapter: Adapter = field(default_factory=Adapter)
    port_name: str = ""

    @property
    def faults(self) -> int:
        """Number of transactions without a valid reply, and of lost adapters."""
        return self.port_losses + sum(servo.counters.failed for servo in self.servos)
