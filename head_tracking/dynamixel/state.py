"""Values that the bus takes and hands out: goals, states, events, counters."""

from __future__ import annotations

import math
from collections.abc import Mapping
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
    def waits(self) -> bool:
        """Whether commands are refused."""
        return self not in (Torque.ON, Torque.OFF_UNTIL_COMMANDED)


@dataclass(frozen=True, slots=True)
class Goal:
    """Where a joint shall go.

    Attributes:
        position: Goal, rad.
        speed: Speed to go there, rad/s; None stands for the joint's own speed.
    """

    position: float
    speed: float | None = None


@dataclass(frozen=True, slots=True)
class CommandResult:
    """What became of an accepted command.

    Attributes:
        positions: Goal positions taken over, rad, by joint; within the limits.
        clamped: By how much a position was moved to reach the limit (taken over minus asked), rad,
            for the joints where it was.
        left_out: Why joints take no goals now, by joint; theirs were dropped.
    """

    positions: Mapping[str, float]
    clamped: Mapping[str, float]
    left_out: Mapping[str, str]


def check_speed(joint_name: str, speed: float) -> None:
    """Refuse a speed that is not finite or not above 0.

    Raises:
        GoalError: It is not.
    """
    if not (math.isfinite(speed) and speed > 0.0):
        raise GoalError(
            f"{joint_name}: speed {speed} rad/s refused; it must be finite and above 0. To stop a "
            "joint, hold it"
        )


class Health(Enum):
    """What is known about a servo."""

    UNKNOWN = "not found yet"
    PRESENT = "present"
    STALE = "stale: no answer since the last one"
    LOST = "lost: it does not answer"
    FAULTED = "faulted: it has shut itself down"
    STOPPED = "stopped on request"


class ServoState(NamedTuple):
    """One joint, as read in one transaction with its servo.

    Where two servos drive a joint, position, velocity and stamp are the first one's that answered,
    the load is the mean, voltage the lowest, temperature the highest, and errors are of both.

    Attributes:
        joint_name: The joint.
        id: Servo id.
        stamp: Time of reading, ns, on the clock given to the bus (middle of the transaction).
        position: Joint position, rad.
        velocity: Joint velocity, rad/s.
        load: Output of the servo, -1 to 1 of full torque, positive towards higher positions.
        voltage: Supply, V.
        temperature: Degrees Celsius.
        error: Error state: `ErrorBits` in protocol 1.0, else the model's hardware errors.
        torque: Whether the driver has torque switched on.
        goal: Goal position that is being written, rad; None while relaxed.
    """

    joint_name: str
    id: int
    stamp: int
    position: float
    velocity: float
    load: float
    voltage: float
    temperature: float
    error: IntFlag
    torque: bool
    goal: float | None

    @property
    def effort(self) -> float:
        """NaN: servos measure a share of their full load, and no torque."""
        return math.nan

    @property
    def position_error(self) -> float | None:
        """Goal minus position, rad; None while relaxed."""
        return None if self.goal is None else self.goal - self.position


class EventKind(Enum):
    """What can happen to a servo between two readings."""

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
    STARTED = "started"
    STOPPED = "stopped"
    PORT_LOST = "port lost"
    PORT_RETURNED = "port returned"


class Symptom(Enum):
    """What can be wrong with a servo, besides what it says itself in its error bits."""

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
        """Whether the joint cannot go where it is told."""
        return self in (Symptom.TORQUE_LOST, Symptom.BLOCKED, Symptom.IDLE, Symptom.MODE)

    @property
    def serious(self) -> bool:
        """Whether the servo does not do what it is told, or cannot be believed."""
        return self not in (Symptom.SUPPLY, Symptom.SAG, Symptom.WARM, Symptom.LINE)


@dataclass(frozen=True, slots=True)
class BusEvent:
    """Something that happened once and that a user may want to know.

    Attributes:
        kind: What it is.
        joint_name: The joint it happened to; empty for what happened to the port.
        text: One sentence for a log.
        stuck: Whether the joint cannot go where it is told any more.
        repeated: Whether it has happened twice before in a short time; a log leaves it out.
    """

    kind: EventKind
    joint_name: str
    text: str
    stuck: bool = False
    repeated: bool = False


class BusReading(NamedTuple):
    """Result of one bus cycle.

    Attributes:
        cycle: Number of the cycle, from 1.
        stamp: Start of the cycle, ns.
        states: What was read in this cycle, by joint name. A joint that did not answer is absent.
        failed: Joints that were asked in this cycle and did not answer.
        lost: Joints that are not asked any more because they have not answered for some time.
        events: What happened since the previous reading, in order.
    """

    cycle: int
    stamp: int
    states: Mapping[str, ServoState]
    failed: tuple[str, ...]
    lost: tuple[str, ...]
    events: tuple[BusEvent, ...]


@dataclass(frozen=True, slots=True)
class ServoStatistics:
    """Counters of one servo since the bus was made.

    Attributes:
        joint_name: The joint it drives.
        id: Servo id.
        replies: Transactions that were answered well.
        retries: Transactions that were repeated.
        timeouts: Attempts without an answer.
        corrupt: Attempts with a damaged answer.
        lost: Whether the servo counts as lost.
        model: Name of the configured model.
        firmware_version: What the servo said; None before it was found.
        health: What is known about it.
        errors: Its error state when it last told.
        last_stamp: When it last answered, ns, on the clock given to the bus; None if never.
        temperature: Degrees Celsius when it last answered; None if that does not count any more.
        voltage: Supply, V, likewise.
        load: Output of the servo, -1 to 1 of its full torque, likewise.
        torque: Why it holds or does not hold its position.
        symptoms: What is wrong with it besides its own errors, a sentence each.
        outcome: What became of its last goal: under way, arrived, missed by so much, or why not.
    """

    joint_name: str
    id: int
    replies: int
    retries: int
    timeouts: int
    corrupt: int
    lost: bool
    model: str = ""
    firmware_version: int | None = None
    health: Health = Health.PRESENT
    errors: IntFlag = NO_ERROR
    last_stamp: int | None = None
    temperature: float | None = None
    voltage: float | None = None
    load: float | None = None
    torque: str = ""
    symptoms: Mapping[Symptom, str] = field(default_factory=dict)
    outcome: str = ""


@dataclass(frozen=True, slots=True)
class BusStatistics:
    """Counters of a bus since it was made.

    Attributes:
        cycles: Cycles run.
        refused_commands: Commands that raised GoalError.
        clamped_commands: Commands with at least one position moved to a limit.
        servos: One entry per servo, in the order of the configuration.
        connected: Whether the port is open.
        port_losses: How often the port has gone.
        adapter: What is known about the adapter.
    """

    cycles: int
    refused_commands: int
    clamped_commands: int
    servos: tuple[ServoStatistics, ...]
    connected: bool = True
    port_losses: int = 0
    adapter: Adapter = field(default_factory=Adapter)
