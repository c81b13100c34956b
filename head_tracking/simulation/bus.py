"""Servos on one bus: bytes in, answers out, without I/O."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from head_tracking.simulation.models import SimulationError
from head_tracking.simulation.motion import STEP, Coupling
from head_tracking.simulation.packets import (
    BROADCAST,
    DamagedPacket,
    Instruction,
    Packet,
    PacketParser,
    encode_status,
)
from head_tracking.simulation.servo import SimulatedServo, Write

if TYPE_CHECKING:
    from head_tracking.simulation.faults import Faults

_BAUD_TOLERANCE: Final = 0.03
_PING_SLOT: Final = 1_000_000  # ns between answers to a broadcast ping (assumed; SDK: 3 ms)


@dataclass(frozen=True, slots=True)
class Answer:
    """Bytes for the master."""

    data: bytes
    # Time from the instruction, or from the end of the previous turn, to the first byte, ns
    delay: int
    # Position in the answers to a group read; servos with the same id have the same turn
    turn: int = 0
    stalled: int = 0  # additional delay of the servo, ns; it may collide with other packets
    complaint: bool = False  # whether it reports a damaged packet, perhaps of another servo
    late: int = 0  # additional delay of the adapter, ns; other packets do not wait for it
    # Whether the adapter returns the bytes of the master; nothing is on the wire
    echo: bool = False


class SimulatedBus:
    """Servos on one bus. Not thread-safe. Time is an argument: integer ns that never decrease.

    Args:
        servos: Servos of any models and both protocols; several with the same id all answer.
        faults: Faults to inject.
        echo: Whether the adapter returns the bytes of the master.
        kept_writes: How many of the latest writes are kept.

    Attributes:
        writes: The latest writes that servos accepted, latest last.
    """

    def __init__(
        self,
        servos: Iterable[SimulatedServo],
        *,
        faults: Faults | None = None,
        echo: bool = False,
        kept_writes: int = 10_000,
    ) -> None:
        self._servos = tuple(servos)
        self.writes: deque[Write] = deque(maxlen=kept_writes)
        for servo in self._servos:
            servo.writes = self.writes
        self._faults, self._echo = faults, echo
        self._couplings: list[Coupling] = []
        self._now = 0
        protocols = sorted({servo.model.protocol for servo in self._servos})
        self._parsers = {protocol: PacketParser(protocol) for protocol in protocols}

    def __iter__(self) -> Iterator[SimulatedServo]:
        return iter(self._servos)

    def __getitem__(self, servo_id: int) -> SimulatedServo:
        """Return a servo by its id; raise SimulationError if there is none."""
        for servo in self._servos:
            if servo.id == servo_id:
                return servo
        ids = ", ".join(str(servo.id) for servo in self._servos)
        raise SimulationError(f"no simulated servo has id {servo_id}; there are {ids}")

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves until the next packet or disturbance."""
        return all(servo.at_rest for servo in self._servos)

    def advance(self, now: int) -> None:
        """Simulate up to `now`, ns."""
        if self._couplings:
            self._advance_coupled(now)
        for servo in self._servos:
            servo.advance(now)

    def couple(self, first: int, second: int, direction: int = -1) -> None:
        """Couple the shafts of two servos, at their present positions, by a stiff bracket.

        Args:
            first: Id of one servo.
            second: Id of the other servo.
            direction: -1 if they turn in opposite directions (mounted face to face), else 1.
        """
        self._couplings.append(Coupling(self[first].drive, self[second].drive, direction))

    def _advance_coupled(self, now: int) -> None:
        time = self._now or now
        while time + STEP <= now and not self.at_rest:
            time += STEP
            for servo in self._servos:
                servo.advance(time)
            for coupling in self._couplings:
                coupling.pull()
        self._now = now if self.at_rest else time

    def receive(self, data: bytes, now: int, baud_rate: int | None = None) -> list[Answer]:
        """Receive bytes from the master; return the answers.

        Args:
            data: The bytes; packets may be split anywhere.
            now: Time of their arrival, ns.
            baud_rate: Baud rate of the master; servos with another one receive nothing. None: any.
        """
        answers = [Answer(data, 0, echo=True)] if self._echo and data else []
        if self._faults is not None:
            data, more = self._faults.request(self, data, now)
            answers += more
        if not data:
            return answers
        if self._couplings:
            self.advance(now)
        for protocol, parser in self._parsers.items():
            for packet in parser.feed(data, now):
                receivers = [
                    servo
                    for servo in self._servos
                    if servo.model.protocol == protocol and _has_baud_rate(servo, baud_rate)
                ]
                for answer in _answers(packet, protocol, receivers, now):
                    answers += (answer,) if self._faults is None else self._faults.answer(answer)
        return answers


def _has_baud_rate(servo: SimulatedServo, baud_rate: int | None) -> bool:
    if baud_rate is None:
        return True
    return abs(baud_rate - servo.baud_rate) < _BAUD_TOLERANCE * servo.baud_rate


def _answers(
    packet: Packet | DamagedPacket, protocol: int, servos: Sequence[SimulatedServo], now: int
) -> Iterator[Answer]:
    if isinstance(packet, Packet) and packet.id == BROADCAST:
        if packet.code == Instruction.PING and protocol == 2:
            for turn, servo_id in enumerate(sorted({servo.id for servo in servos})):
                for servo in servos:
                    status = servo.answer_ping(now) if servo.id == servo_id else None
                    if status is not None:
                        delay = servo.return_delay + _PING_SLOT
                        yield Answer(encode_status(protocol, status), delay, turn)
            return
        if packet.code in (Instruction.SYNC_READ, Instruction.BULK_READ):
            yield from _read_in_turn(packet, protocol, servos, now)
            return
    for servo in servos:
        delay = servo.return_delay  # a new value applies from the next packet on
        if isinstance(packet, DamagedPacket):
            status, complaint = servo.complain(packet, now), True
        else:
            status, complaint = servo.execute(packet, now), False
        if status is not None:
            yield Answer(encode_status(protocol, status), delay, complaint=complaint)


def _read_in_turn(
    packet: Packet, protocol: int, servos: Sequence[SimulatedServo], now: int
) -> Iterator[Answer]:
    """Yield the answers to a sync or bulk read.

    Each servo waits for the answer of the previous one in the list. If one is missing, those after
    it do not answer (DynamixelSDK issue 331).
    """
    control = "sts" if packet.code == Instruction.SYNC_READ else "gain"  # MX
    able = [s for s in servos if s.model.protocol == 2 or s.model.control == control]
    for turn, (servo_id, address, length) in enumerate(_shares(packet, protocol)):
        answered = False
        for servo in able:
            status = servo.answer_read(address, length, now) if servo.id == servo_id else None
            if status is not None:
                yield Answer(encode_status(protocol, status), servo.return_delay, turn)
                answered = True
        if not answered:
            break


def _shares(packet: Packet, protocol: int) -> list[tuple[int, int, int]]:
    """Return id, address and length of each share of a sync or bulk read."""
    data = packet.parameters

    def number(at: int) -> int:
        return int.from_bytes(data[at : at + protocol], "little")

    if packet.code == Instruction.SYNC_READ:
        return [(servo_id, number(0), number(protocol)) for servo_id in data[2 * protocol :]]
    if protocol == 1:
        return [(data[at + 1], data[at + 2], data[at]) for at in range(1, len(data) - 2, 3)]
    return [(data[at], number(at + 1), number(at + 3)) for at in range(0, len(data) - 4, 5)]
