"""Simulated servos on one wire: packets in, answers out, no input or output of its own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from head_tracking.simulation.exceptions import SimulationError, UnknownServoError
from head_tracking.simulation.motion import STEP, Coupling
from head_tracking.simulation.packets import (
    BROADCAST,
    LONGEST,
    DamagedPacket,
    Instruction,
    Packet,
    PacketParser,
    Status,
    encode_joint_status,
    encode_status,
)
from head_tracking.simulation.servo import SimulatedServo
from head_tracking.simulation.write_log import WriteLog

_BAUD_TOLERANCE: Final = 0.03
_PING_SLOT: Final = 1_000_000  # ns between the answers to a ping of all (ours; the SDK allows 3 ms)


@dataclass(frozen=True, slots=True)
class Answer:
    """Bytes that go back to the master.

    Attributes:
        data: The bytes on the wire.
        delay: Time from the instruction, or from the end of the turn before, to the first byte, ns.
        turn: Servos that answer in turn wait for the end of the turn before; servos with the same
            id have the same turn.
        stalled: Time by which the servo itself is late, ns: it talks when others may.
        complaint: Whether the servo says that a packet was damaged, perhaps one for somebody else.
        late: Time by which the adapter hands the answer on too late, ns; others do not wait for it.
        echo: Whether it is the adapter that sends back what it was sent; nothing is on the wire.
    """

    data: bytes
    delay: int
    turn: int = 0
    stalled: int = 0
    complaint: bool = False
    late: int = 0
    echo: bool = False


class FaultInjection(Protocol):
    """What goes wrong on a bus; see `Faults`."""

    def request(self, bus: SimulatedBus, data: bytes, now: int) -> tuple[bytes, list[Answer]]:
        """Return what the servos hear instead of `data`, and what goes back at once."""

    def answer(self, answer: Answer) -> Iterable[Answer]:
        """Return what becomes of an answer."""


class SimulatedBus:
    """Servos on one wire. Not thread-safe; time is passed in, as integer ns that never fall.

    Args:
        servos: The servos, of any models and both protocols. Two with the same id answer at the
            same time, as real ones do.
        faults: What goes wrong.
        echo: Whether the adapter sends back whatever it is sent.
        write_log: Is told what has really reached the servos.

    Attributes:
        write_log: What has really reached the servos.

    Raises:
        SimulationError: There is no servo.
    """

    def __init__(
        self,
        servos: Iterable[SimulatedServo],
        *,
        faults: FaultInjection | None = None,
        echo: bool = False,
        write_log: WriteLog | None = None,
    ) -> None:
        self._servos = tuple(servos)
        if not self._servos:
            raise SimulationError("a simulated bus needs at least one servo")
        self.write_log = write_log or WriteLog()
        for servo in self._servos:
            servo.write_log = self.write_log
        self._faults, self._echo = faults, echo
        self._couplings: list[Coupling] = []
        self._now = 0
        protocols = sorted({servo.model.protocol for servo in self._servos})
        self._parsers = {protocol: PacketParser(protocol) for protocol in protocols}

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
        if self._couplings:
            self._advance_coupled(now)
        for servo in self._servos:
            servo.advance(now)

    def couple(self, first: int, second: int, direction: int = -1) -> None:
        """Join the shafts of two servos, as they stand, by a stiff bracket: they drive one joint.

        Args:
            first: Id of one.
            second: Id of the other one.
            direction: -1 if they turn against each other, face to face; else 1.
        """
        self._couplings.append(self[first].couple(self[second], direction))

    def _advance_coupled(self, now: int) -> None:
        """Let shafts that are joined move in small steps, so that each follows the other."""
        time = self._now or now
        while time + STEP < now and not self.at_rest:
            time += STEP
            for servo in self._servos:
                servo.advance(time)
            for coupling in self._couplings:
                coupling.pull()
        self._now = now

    def receive(self, data: bytes, now: int, baud_rate: int | None = None) -> list[Answer]:
        """Take bytes from the master and return what goes back.

        Args:
            data: Any number of bytes; packets may be cut anywhere.
            now: Time they arrived, ns.
            baud_rate: Bits per second at which they came: servos with another one hear nothing.
                None: all of them hear.
        """
        answers = [Answer(data, 0, echo=True)] if self._echo and data else []
        if self._faults is not None:
            data, more = self._faults.request(self, data, now)
            answers += more
        if not data:
            return answers
        for protocol, parser in self._parsers.items():
            for packet in parser.feed(data, now):
                hearers = [
                    servo
                    for servo in self._servos
                    if servo.model.protocol == protocol and _understands(servo, baud_rate)
                ]
                for answer in _answers(packet, protocol, hearers, now):
                    answers += (answer,) if self._faults is None else self._faults.answer(answer)
        return answers


def _understands(servo: SimulatedServo, baud_rate: int | None) -> bool:
    if baud_rate is None:
        return True
    return abs(baud_rate - servo.baud_rate) < _BAUD_TOLERANCE * servo.baud_rate


def _answers(
    packet: Packet | DamagedPacket, protocol: int, servos: Sequence[SimulatedServo], now: int
) -> Iterator[Answer]:
    """Yield what servos that hear a packet send.

    In a group read each waits until the one before it in the list has answered. So if one of them
    is missing, those behind it say nothing (as users of real servos report, DynamixelSDK issue
    331).
    """
    if isinstance(packet, Packet) and packet.id == BROADCAST:
        if packet.code == Instruction.PING and protocol == 2:
            for turn, servo_id in enumerate(sorted({servo.id for servo in servos})):
                for servo in servos:
                    status = servo.answer_ping(now) if servo.id == servo_id else None
                    if status is not None:
                        delay = servo.return_delay + _PING_SLOT
                        yield Answer(encode_status(protocol, status), delay, turn)
            return
        reads = _group_reads(packet, protocol)
        if reads is not None:
            yield from _read_in_turn(packet.code, reads, protocol, servos, now)
            return
    for servo in servos:
        delay = servo.return_delay  # a new one holds from the next packet on
        if isinstance(packet, DamagedPacket):
            status, complaint = servo.complain(packet, now), True
        else:
            status, complaint = servo.execute(packet, now), False
        if status is not None:
            yield Answer(encode_status(protocol, status), delay, complaint=complaint)


def _group_reads(packet: Packet, protocol: int) -> list[tuple[int, int, int]] | None:
    """Return id, address and length of each read in a packet; None if it is no group read."""
    code, data = packet.code, packet.parameters
    if protocol == 1:
        if code == Instruction.SYNC_READ:
            return [(servo_id, data[0], data[1]) for servo_id in data[2:]]
        if code != Instruction.BULK_READ:
            return None
        shares = data[1:]
        if not shares or len(shares) % 3 or data[0] != 0:
            return []
        return [(shares[at + 1], shares[at + 2], shares[at]) for at in range(0, len(shares), 3)]

    def word(at: int) -> int:
        return int.from_bytes(data[at : at + 2], "little")

    if code in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
        return [(servo_id, word(0), word(2)) for servo_id in data[4:]]
    if code in (Instruction.BULK_READ, Instruction.FAST_BULK_READ):
        starts = range(0, len(data), 5) if len(data) % 5 == 0 else ()
        return [(data[at], word(at + 1), word(at + 3)) for at in starts]
    return None


def _read_in_turn(
    code: int,
    reads: Sequence[tuple[int, int, int]],
    protocol: int,
    servos: Sequence[SimulatedServo],
    now: int,
) -> Iterator[Answer]:
    fast = code in (Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ)
    able = [s for s in servos if _takes_part(s, code)]
    shares: list[Status] = []
    first_delay = 0
    for turn, (servo_id, address, length) in enumerate(reads):
        there = False
        for servo in able:
            status = servo.answer_read(address, length, now) if servo.id == servo_id else None
            if status is None:
                continue
            if not fast:
                yield Answer(encode_status(protocol, status), servo.return_delay, turn)
            elif not there:
                first_delay = first_delay or servo.return_delay
                shares.append(status)
            there = True
        if not there:
            break
    size = sum(length + 4 for _, _, length in reads)
    if shares and size <= LONGEST[2]:  # a longer one is not a packet any more
        yield Answer(encode_joint_status(shares, [length for _, _, length in reads]), first_delay)


def _takes_part(servo: SimulatedServo, code: int) -> bool:
    model = servo.model
    if model.protocol == 1:
        return model.bulk_read if code == Instruction.BULK_READ else model.control == "sts"
    fast = code in (Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ)
    first = model.fast_sync_read
    return not fast or (first is not None and servo.register("Firmware Version") >= first)
