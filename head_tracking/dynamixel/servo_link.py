"""One servo on the port: transactions with retries and counters, torque on and off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Concatenate, Final, NamedTuple, ParamSpec, TypeVar

from head_tracking.dynamixel.control_table import Block
from head_tracking.dynamixel.conversions import SIGN_BIT
from head_tracking.dynamixel.exceptions import (
    CorruptReplyError,
    RegisterRefusedError,
    ReplyTimeoutError,
)
from head_tracking.dynamixel.models import ServoModel
from head_tracking.dynamixel.port import ServoPort
from head_tracking.dynamixel.protocol1 import REFUSALS, ErrorBits, describe_errors

_P = ParamSpec("_P")
_T = TypeVar("_T")

_PATIENCE: Final = 2  # retries where a failure would leave a servo in the wrong state
SLOWEST: Final = 1
"""Lowest Moving Speed; 0 would be full speed."""


@dataclass(slots=True)
class LinkCounters:
    """What became of the transactions with one servo."""

    replies: int = 0
    retries: int = 0
    timeouts: int = 0
    corrupt: int = 0


class Feedback(NamedTuple):
    """One reading, in register values."""

    ticks: int
    speed: int
    load: int
    voltage: int
    temperature: int
    error: ErrorBits


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

    def ping(self, retries: int = 0) -> ErrorBits:
        """Ask the servo whether it is there."""
        return self._repeat(retries, self._port.ping, self.id)

    def read_feedback(self, retries: int) -> Feedback:
        """Read position, speed, load, voltage and temperature in one transaction."""
        return self._repeat(retries, self._read_feedback, self.id)

    def read(self, block: Block, retries: int = _PATIENCE) -> tuple[int, ...]:
        """Read registers and return one value for each."""
        reply = self._repeat(retries, self._port.read, self.id, block.address, block.length)
        return block.decode(reply.data)

    def read_position(self, retries: int = _PATIENCE) -> int:
        """Return the present position, in ticks."""
        return self.read(self.model.control_table.block("Present Position"), retries)[0]

    def write(self, block: Block, *values: int) -> None:
        """Write registers.

        Raises:
            RegisterRefusedError: The servo answers that it will not.
        """
        data = block.encode(*values)
        if not self.acknowledges_writes:
            self._port.write(self.id, block.address, data, acknowledged=False)
            return
        error = self._repeat(_PATIENCE, self._port.write, self.id, block.address, data)
        if error & REFUSALS:
            names = ", ".join(
                f"{register.name} = {value}"
                for register, value in zip(block.registers, values, strict=True)
            )
            raise RegisterRefusedError(
                f"servo {self.id} refused {names}: {describe_errors(error & REFUSALS)}"
            )

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

    def set_torque(self, on: bool) -> None:
        """Switch torque and make sure of it; raises as `write_verified` does."""
        self.write_verified(self.model.control_table.block("Torque Enable"), int(on))

    def pin(self, lowest: int, highest: int) -> int:
        """Switch torque on without a jump and return the goal, in ticks.

        The goal is written, and read back, before torque is switched on, because a servo starts
        for its old goal at that moment. It is written together with the lowest speed, because an
        AX servo switches torque on by itself when a goal arrives, and a relaxed servo may have
        been moved since its position was read.

        Args:
            lowest: Lowest tick the goal may have.
            highest: Highest tick the goal may have. A shaft outside creeps to the limit.

        Raises:
            RegisterRefusedError: The servo does not take the goal or the torque.
            CommunicationError: The servo does not answer.
        """
        goal = max(lowest, min(highest, self.read_position()))
        self.write_verified(self.model.goal, goal, SLOWEST)
        self.set_torque(True)
        return goal

    def release(self) -> None:
        """Write torque off once and wait for nothing: for a servo that does not answer."""
        block = self.model.control_table.block("Torque Enable")
        self._port.write(self.id, block.address, block.encode(0), acknowledged=False)

    def _read_feedback(self, servo_id: int) -> Feedback:
        model = self.model
        block = model.feedback
        reply = self._port.read(servo_id, block.address, block.length)
        ticks, speed, load, voltage, temperature = block.decode(reply.data)
        # The checksum of protocol 1.0 is weak: two damaged bits can cancel each other out.
        if ticks >= model.ticks or max(speed, load) >= 2 << SIGN_BIT:
            raise CorruptReplyError(f"servo {servo_id}: impossible feedback {reply.data!r}")
        return Feedback(ticks, speed, load, voltage, temperature, reply.error)

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
            except ReplyTimeoutError:
                counters.timeouts += 1
                if attempt == retries:
                    raise
            except CorruptReplyError:
                counters.corrupt += 1
                if attempt == retries:
                    raise
            else:
                counters.replies += 1
                return result
        raise AssertionError("a negative number of retries")
