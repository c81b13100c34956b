"""Simulated servos on one wire: bytes in, answers out, no input or output of its own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, Protocol

from head_tracking.simulation.answer import Answer, Line, faultless
from head_tracking.simulation.exceptions import SimulationError, UnknownServoError
from head_tracking.simulation.group_reads import Reading, at_once, group_read
from head_tracking.simulation.oracle import Oracle
from head_tracking.simulation.protocol1 import DamagedPacket, InstructionParser
from head_tracking.simulation.protocol2 import DamagedPacket2, InstructionParser2
from head_tracking.simulation.servo import Damaged, Packet, SimulatedServo

_BAUD_TOLERANCE: Final = 0.03


class Misfortune(Protocol):
    """What happens to the bytes that the master sends, and to the servos; see `Faults`."""

    def befall(self, bus: SimulatedBus, data: bytes, now: int) -> tuple[bytes, list[Answer]]:
        """Return what the servos hear instead of `data`, and what goes back at once."""


class SimulatedBus:
    """Servos on one wire. Not thread-safe; time is passed in, as integer ns that never fall.

    Args:
        servos: The servos, of any models and both protocols. Two with the same id answer at the
            same time, as real ones do.
        line: Every answer passes here on its way out.
        misfortune: What happens besides.
        echo: Whether the adapter sends back whatever it is sent.
        oracle: Is told what has really reached the servos.

    Attributes:
        oracle: What has really reached the servos.

    Raises:
        SimulationError: There is no servo.
    """

    def __init__(
        self,
        servos: Iterable[SimulatedServo],
        line: Line = faultless,
        *,
        misfortune: Misfortune | None = None,
        echo: bool = False,
        oracle: Oracle | None = None,
    ) -> None:
        self._servos = tuple(servos)
        if not self._servos:
            raise SimulationError("a simulated bus needs at least one servo")
        self.oracle = oracle or Oracle()
        for servo in self._servos:
            servo.oracle = self.oracle
        self._line = line
        self._misfortune = misfortune
        self._echo = echo
        protocols = {servo.model.protocol for servo in self._servos}
        parsers = (InstructionParser(), InstructionParser2())
        self._parsers = [parsers[protocol - 1] for protocol in sorted(protocols)]

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

    def receive(self, data: bytes, now: int, baud_rate: int | None = None) -> list[Answer]:
        """Take bytes from the master and return what goes back.

        Args:
            data: Any number of bytes; packets may be cut anywhere.
            now: Time they arrived, ns.
            baud_rate: Bits per second at which they came: servos with another one hear nothing.
                None: all of them hear.
        """
        answers = [Answer(data, 0)] if self._echo and data else []
        if self._misfortune is not None:
            data, more = self._misfortune.befall(self, data, now)
            answers += more
        for parser in self._parsers:
            for packet in parser.feed(data, now):
                hearers = [servo for servo in self._servos if _understands(servo, baud_rate)]
                for answer in self._answers(packet, hearers, now):
                    answers.extend(self._line(answer))
        return answers

    def _answers(
        self, packet: Packet | Damaged, servos: list[SimulatedServo], now: int
    ) -> Iterator[Answer]:
        if not isinstance(packet, (DamagedPacket, DamagedPacket2)):
            in_turn = group_read(packet, servos, now)
            if in_turn is not None:
                yield from _one_after_the_other(in_turn)
                return
        readings = []
        for servo in servos:
            delay = servo.return_delay  # a new one holds from the next packet on
            if isinstance(packet, (DamagedPacket, DamagedPacket2)):
                status = servo.complain(packet, now)
            else:
                status = servo.execute(packet, now)
            if status is not None:
                readings.append(Reading(status.encode(), delay))
        if readings:
            yield Answer(*at_once(readings))


def _one_after_the_other(readings: Iterable[Reading]) -> Iterator[Answer]:
    for number, (data, delay) in enumerate(readings):
        yield Answer(data, delay, follows=number > 0)


def _understands(servo: SimulatedServo, baud_rate: int | None) -> bool:
    if baud_rate is None:
        return True
    return abs(baud_rate - servo.baud_rate) < _BAUD_TOLERANCE * servo.baud_rate
