"""One servo on the port: transactions with retries and counters, torque on and off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntFlag
from typing import Concatenate, Final, NamedTuple, ParamSpec, TypeVar

from head_tracking.dynamixel.control_table import SIGN_BIT, Block, Register
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    CorruptReplyError,
    RegisterRefusedError,
    ReplyTimeoutError,
)
from head_tracking.dynamixel.models import ServoModel
from head_tracking.dynamixel.port import Reply, ServoPort
from head_tracking.dynamixel.protocol import (
    ALERT,
    REFUSALS,
    ErrorBits,
    describe_errors,
    describe_status,
)

_P = ParamSpec("_P")
_T = TypeVar("_T")

_PATIENCE: Final = 2  # retries where a failure would leave a servo in the wrong state
_WATCHDOG_UNIT: Final = 0.02  # s
_MAGNITUDES: Final = 2 << SIGN_BIT
_LONGEST_READ: Final = 64  # bytes
SLOWEST: Final = 1
"""Lowest goal speed; 0 would be full speed."""


@dataclass(slots=True)
class LinkCounters:
    """What became of the transactions with one servo."""

    replies: int = 0
    retries: int = 0
    timeouts: int = 0
    corrupt: int = 0


class Feedback(NamedTuple):
    """One reading, in register values.

    The error is the error byte: bits of state in protocol 1.0, in protocol 2.0 the alert bit.
    """

    ticks: int
    speed: int
    load: int
    voltage: int
    temperature: int
    error: int


class ServoLink:
    """Talks to one servo. Used by the thread that owns the port, and by no other.

    Args:
        port: The open port.
        servo_id: The servo's id.
        model: Its model.

    Attributes:
        acknowledges_writes: Whether the servo answers writes (Status Return Level 2).
        counters: What became of the transactions.
    """

    def __init__(self, port: ServoPort, servo_id: int, model: ServoModel) -> None:
        self.id = servo_id
        self.model = model
        self.acknowledges_writes = True
        self.counters = LinkCounters()
        self._port = port
        self._protocol = model.protocol
        self._order = model.feedback_order
        self._ticks = model.ticks
        self._magnitudes = model.sign_magnitude

    def ping(self, retries: int = 0) -> int:
        """Ask the servo whether it is there; return its error byte."""
        return self._repeat(retries, self._port.ping, self.id, self._protocol)

    def read_feedback(self, retries: int) -> Feedback:
        """Read position, speed, load, voltage and temperature in one transaction."""
        return self._repeat(retries, self._read_feedback, self.id)

    def feedback(self, reply: Reply) -> Feedback:
        """Return what the answer to a read of the feedback block says.

        Raises:
            CorruptReplyError: The servo cannot have said that.
        """
        values = self.model.feedback.decode(reply.data)
        a, b, c, d, e = self._order
        ticks, speed, load = values[a], values[b], values[c]
        # The checksum of protocol 1.0 is weak: two damaged bits can cancel each other out.
        if self._magnitudes and (
            speed >= _MAGNITUDES
            or load >= _MAGNITUDES
            or (ticks >= self._ticks and not self.model.endless)
        ):
            raise CorruptReplyError(f"servo {self.id}: impossible feedback {reply.data!r}")
        return Feedback(ticks, speed, load, values[d], values[e], reply.error)

    def read(self, block: Block, retries: int = _PATIENCE) -> tuple[int, ...]:
        """Read registers and return one value for each."""
        reply = self._repeat(
            retries, self._port.read, self.id, block.address, block.length, self._protocol
        )
        return block.decode(reply.data)

    def get(self, name: str) -> int:
        """Read one register."""
        return self.read(self.model.control_table.block(name))[0]

    def read_position(self, retries: int = _PATIENCE) -> int:
        """Return the present position, in ticks."""
        return self.read(self.model.control_table.block("Present Position"), retries)[0]

    def write(self, block: Block, *values: int) -> None:
        """Write registers.

        Raises:
            RegisterRefusedError: The servo answers that it will not.
        """
        data = block.encode(*values)
        address = block.address
        if not self.acknowledges_writes:
            self._port.write(self.id, address, data, acknowledged=False, protocol=self._protocol)
            return
        error = self._repeat(
            _PATIENCE, self._port.write, self.id, address, data, protocol=self._protocol
        )
        refusal = self._refusal(error)
        if refusal:
            pairs = zip(block.registers, values, strict=True)
            names = ", ".join(f"{register.name} = {value}" for register, value in pairs)
            raise RegisterRefusedError(f"servo {self.id} refused {names}: {refusal}")

    def write_verified(self, block: Block, *values: int) -> None:
        """Write registers and read them back until the servo holds the values.

        Raises:
            RegisterRefusedError: The servo refuses, or answers but keeps other values.
            CommunicationError: The servo does not answer.
        """
        for _ in range(1 + _PATIENCE):
            self.write(block, *values)
            kept = self.read(block)
            if kept == values:
                return
        names = ", ".join(register.name for register in block.registers)
        raise RegisterRefusedError(
            f"servo {self.id} keeps {kept} in {names} instead of {values}; it may have shut down: "
            "look at its error bits (overload, overheating), let it cool, or cycle its power"
        )

    def set(self, name: str, value: int) -> None:
        """Write one register and make sure of it; raises as `write_verified` does."""
        self.write_verified(self.model.control_table.block(name), value)

    def set_torque(self, on: bool) -> None:
        """Switch torque and make sure of it; raises as `write_verified` does."""
        self.set("Torque Enable", int(on))

    def pin(self, lowest: int, highest: int, fold: Callable[[int], int] = int) -> int:
        """Switch torque on without a jump and return the goal, in ticks.

        The goal is written, and read back, before torque is switched on, because a servo starts
        for its old goal at that moment. It is written together with the lowest speed, because an
        AX servo switches torque on by itself when a goal arrives, and a relaxed servo may have
        been moved since its position was read.

        Args:
            lowest: Lowest tick the goal may have.
            highest: Highest tick the goal may have. A shaft outside creeps to the limit.
            fold: Brings a position of another turn into the joint's.

        Raises:
            RegisterRefusedError: The servo does not take the goal or the torque.
            CommunicationError: The servo does not answer.
        """
        goal = max(lowest, min(highest, fold(self.read_position())))
        values = (goal, SLOWEST) if self.model.position_first else (SLOWEST, goal)
        self.write_verified(self.model.goal, *values)
        self.set_torque(True)
        return goal

    def release(self) -> None:
        """Write torque off once and wait for nothing: for a servo that does not answer."""
        block = self.model.control_table.block("Torque Enable")
        self._port.write(
            self.id, block.address, block.encode(0), acknowledged=False, protocol=self._protocol
        )

    def set_watchdog(self, seconds: float) -> None:
        """Let the servo stop by itself when it hears no packet for some time.

        It is cleared first, because one that has tripped refuses goals until then.

        Args:
            seconds: That time; 0 switches the watchdog off.

        Raises:
            RegisterRefusedError: The servo does not take it.
            CommunicationError: The servo does not answer.
        """
        self.set("Bus Watchdog", 0)
        if seconds > 0.0:
            self.set("Bus Watchdog", max(1, min(127, round(seconds / _WATCHDOG_UNIT))))

    def errors(self, error: int) -> IntFlag:
        """Return the error state that goes with the error byte of an answer.

        Protocol 2.0 tells only that there is one: its register is read.

        Raises:
            CommunicationError: The servo does not answer.
        """
        if self._protocol == 1:
            return ErrorBits(error & 0x7F)
        if not error & ALERT:
            return self.model.errors(0)
        known = sum(self.model.errors)
        return self.model.errors(self.get("Hardware Error Status") & known)

    def restore_torque_limit(self) -> None:
        """Undo what a protocol 1.0 servo does to shut down: it sets its Torque Limit to 0.

        Raises:
            RegisterRefusedError: The servo does not take it.
            CommunicationError: The servo does not answer.
        """
        self.set("Torque Limit", self.get("Max Torque"))

    def reboot(self) -> None:
        """Restart a protocol 2.0 servo; raises CommunicationError if it does not say yes."""
        self._repeat(_PATIENCE, self._port.reboot, self.id)

    def count(self, failure: CommunicationError) -> None:
        """Count a failed transaction that somebody else has made."""
        if isinstance(failure, ReplyTimeoutError):
            self.counters.timeouts += 1
        else:
            self.counters.corrupt += 1

    def registers(self) -> list[tuple[Register, int]]:
        """Read all registers; raises CommunicationError if the servo does not answer."""
        return [
            (register, value)
            for block in self.model.control_table.runs(_LONGEST_READ)
            for register, value in zip(block.registers, self.read(block), strict=True)
        ]

    def _refusal(self, error: int) -> str:
        """Return why the servo will not, or nothing."""
        if self._protocol == 1:
            refusals = ErrorBits(error & REFUSALS)
            return describe_errors(refusals) if refusals else ""
        return describe_status(error & ~ALERT) if error & ~ALERT else ""

    def _read_feedback(self, servo_id: int) -> Feedback:
        block = self.model.feedback
        reply = self._port.read(servo_id, block.address, block.length, self._protocol)
        return self.feedback(reply)

    def _repeat(
        self,
        retries: int,
        transaction: Callable[Concatenate[int, _P], _T],
        servo_id: int,
        *args: _P.args,
        **kwargs: _P.kwargs,
    ) -> _T:
        counters = self.counters
        for attempt in range(retries + 1):
            counters.retries += attempt > 0
            try:
                result = transaction(servo_id, *args, **kwargs)
            except (ReplyTimeoutError, CorruptReplyError) as failure:
                self.count(failure)
                if attempt == retries:
                    raise
            else:
                counters.replies += 1
                return result
        raise AssertionError("a negative number of retries")
