"""Instructions that several servos answer, one after the other.

A servo waits until the one before it in the list has answered. So if one of them is missing, those
behind it say nothing (as users of real servos report, DynamixelSDK issue 331).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from typing import NamedTuple

from head_tracking.dynamixel.protocol import BROADCAST_ID, Instruction
from head_tracking.simulation.protocol1 import InstructionPacket, StatusPacket
from head_tracking.simulation.protocol2 import InstructionPacket2, StatusPacket2, joint_status
from head_tracking.simulation.servo import Packet, SimulatedServo, Status

_SLOT = 1_000_000  # ns between the answers to a ping of all (ours; the SDK allows for 3 ms)
_FAST = (Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ)
_SEPARATE = (Instruction.SYNC_READ, Instruction.BULK_READ)


class Reading(NamedTuple):
    """What one servo sends in its turn.

    Attributes:
        data: The bytes.
        delay: Time it waits before, ns.
    """

    data: bytes
    delay: int


def group_read(packet: Packet, servos: Sequence[SimulatedServo], now: int) -> list[Reading] | None:
    """Return what servos answer in turn; None if the packet is no such instruction."""
    if packet.id != BROADCAST_ID:
        return None
    code = packet.instruction
    if isinstance(packet, InstructionPacket):
        if code != Instruction.BULK_READ:
            return None
        able = [servo for servo in servos if servo.model.bulk_read]
        return _read_in_turn(packet.bulk_read_shares(), able, now)
    if code == Instruction.PING:
        return _ping(servos, now)
    if code in _SEPARATE:
        return _read_in_turn(packet.reads(), servos, now)
    if code in _FAST:
        return _read_fast(packet, servos, now)
    return None


def at_once(readings: Sequence[Reading]) -> Reading:
    """Return what the wire carries when servos with the same id talk at the same time.

    It is low as long as one of them pulls it low, so only equal answers stay whole.
    """
    data = readings[0].data
    for other in readings[1:]:
        data = bytes(a & b for a, b in zip_longest(data, other.data, fillvalue=0xFF))
    return Reading(data, min(reading.delay for reading in readings))


def _ping(servos: Sequence[SimulatedServo], now: int) -> list[Reading]:
    readings: dict[int, list[Reading]] = {}
    for servo in sorted(servos, key=lambda servo: servo.id):
        status = servo.answer_ping(now)
        if status is not None:
            reading = Reading(status.encode(), servo.return_delay + _SLOT)
            readings.setdefault(servo.id, []).append(reading)
    return [at_once(twins) for twins in readings.values()]


def _read_in_turn(
    reads: Sequence[tuple[int, int, int]], servos: Sequence[SimulatedServo], now: int
) -> list[Reading]:
    readings: list[Reading] = []
    for servo_id, address, length in reads:
        answers = _answers(servos, servo_id, address, length, now)
        if not answers:
            break
        readings.append(at_once([Reading(status.encode(), delay) for status, delay in answers]))
    return readings


def _read_fast(
    packet: InstructionPacket2, servos: Sequence[SimulatedServo], now: int
) -> list[Reading]:
    able = [s for s in servos if _knows_fast_reads(s)]
    reads = packet.reads()
    shares: list[StatusPacket2] = []
    delay = 0
    for servo_id, address, length in reads:
        answers = _answers(able, servo_id, address, length, now)
        if not answers:
            break
        status, pause = answers[0]
        assert isinstance(status, StatusPacket2)
        delay = delay or pause
        shares.append(status)
    if not shares:
        return []
    return [Reading(joint_status(shares, [length for _, _, length in reads]), delay)]


def _knows_fast_reads(servo: SimulatedServo) -> bool:
    first = servo.model.fast_sync_read
    return first is not None and servo.register("Firmware Version") >= first


def _answers(
    servos: Sequence[SimulatedServo], servo_id: int, address: int, length: int, now: int
) -> list[tuple[Status, int]]:
    found: list[tuple[Status, int]] = []
    for servo in servos:
        if servo.id == servo_id:
            status = servo.answer_read(address, length, now)
            if isinstance(status, (StatusPacket, StatusPacket2)):
                found.append((status, servo.return_delay))
    return found
