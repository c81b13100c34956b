"""Simulated servos on one wire: bytes in, answers out, no input or output of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from head_tracking.simulation.exceptions import SimulationError, UnknownServoError
from head_tracking.simulation.protocol1 import DamagedPacket, InstructionParser
from head_tracking.simulation.servo import SimulatedServo


@dataclass(frozen=True, slots=True)
class Answer:
    """Bytes that a servo sends.

    Attributes:
        data: The bytes on the wire.
        delay: Time from the instruction to the first byte, ns.
    """

    data: bytes
    delay: int


Line = Callable[[Answer], Iterable[Answer]]
"""What the wire does to an answer: deliver it, drop it, change it, add to it."""


def _faultless(answer: Answer) -> Iterable[Answer]:
    return (answer,)


class SimulatedBus:
    """Servos on one wire. Not thread-safe; time is passed in, as integer ns that never fall.

    Args:
        servos: The servos. Two with the same id both answer, as real ones do.
        line: Every answer passes here on its way out.

    Raises:
        SimulationError: There is no servo.
    """

    def __init__(self, servos: Iterable[SimulatedServo], line: Line = _faultless) -> None:
        self._servos = tuple(servos)
        if not self._servos:
            raise SimulationError("a simulated bus needs at least one servo")
        self._line = line
        self._parser = InstructionParser()

    def __iter__(self) -> Iterator[SimulatedServo]:
        return iter(self._servos)

    def __getitem__(self, servo_id: int) -> SimulatedServo:
        """Return the servo with an id.

        Raises:
            UnknownServoError: There is none.
        """
        for servo in self._servos:
            if servo.id == servo_id:
                return servo
        ids = ", ".join(str(servo.id) for servo in self._servos)
        raise UnknownServoError(f"no simulated servo has id {servo_id}; there are {ids}")

    @property
    def at_rest(self) -> bool:
        """Whether nothing will move until somebody does something."""
        return all(servo.at_rest for servo in self._servos)

    def advance(self, now: int) -> None:
        """Let time pass up to `now`, ns."""
        for servo in self._servos:
            servo.advance(now)

    def receive(self, data: bytes, now: int) -> list[Answer]:
        """Take bytes from the master and return what goes back.

        Args:
            data: Any number of bytes; packets may be cut anywhere.
            now: Time they arrived, ns.
        """
        answers: list[Answer] = []
        for packet in self._parser.feed(data, now):
            for servo in self._servos:
                delay = servo.return_delay  # a new one holds from the next packet on
                if isinstance(packet, DamagedPacket):
                    status = servo.complain(packet, now)
                else:
                    status = servo.execute(packet, now)
                if status is not None:
                    answers.extend(self._line(Answer(status.encode(), delay)))
        return answers
