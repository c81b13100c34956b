"""What was measured: the values a bus cycle hands out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from head_tracking.dynamixel.protocol1 import ErrorBits


@dataclass(frozen=True, slots=True)
class ServoState:
    """One servo, as read in one transaction.

    Attributes:
        joint_name: The joint it drives.
        id: Servo id.
        stamp: Time of reading, ns, on the clock given to the bus (middle of the transaction).
        position: Joint position, rad.
        velocity: Joint velocity, rad/s.
        load: Output of the servo, -1 to 1 of full torque, positive towards higher positions.
        voltage: Supply, V.
        temperature: Degrees Celsius.
        error: Error bits of the reply.
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
    error: ErrorBits
    torque: bool
    goal: float | None


class EventKind(Enum):
    """What can happen to a servo between two readings."""

    LOST = "lost"
    RETURNED = "returned"
    UNUSABLE = "unusable"
    TORQUE_ON = "torque on"
    TORQUE_OFF = "torque off"
    TORQUE_FAILED = "torque failed"


@dataclass(frozen=True, slots=True)
class BusEvent:
    """Something that happened once and that a user may want to know.

    Attributes:
        kind: What it is.
        joint_name: The joint it happened to.
        text: One sentence for a log; names the servo's id, not the joint.
    """

    kind: EventKind
    joint_name: str
    text: str


@dataclass(frozen=True, slots=True)
class BusReading:
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
        failed_cycles: Failed cycles in a row, 0 when the last one was answered.
        lost: Whether the servo counts as lost.
    """

    joint_name: str
    id: int
    replies: int
    retries: int
    timeouts: int
    corrupt: int
    failed_cycles: int
    lost: bool


@dataclass(frozen=True, slots=True)
class BusStatistics:
    """Counters of a bus since it was made.

    Attributes:
        cycles: Cycles run.
        refused_commands: Commands that raised GoalError.
        clamped_commands: Commands with at least one position moved to a limit.
        servos: One entry per servo, in the order of the configuration.
    """

    cycles: int
    refused_commands: int
    clamped_commands: int
    servos: tuple[ServoStatistics, ...]
