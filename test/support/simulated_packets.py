"""Packets as tests write them: the simulator's own, with builders for every instruction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

from head_tracking.dynamixel import servo_model
from head_tracking.simulation import SimulatedServo
from head_tracking.simulation.packets import BROADCAST, Instruction, Packet, encode
from head_tracking.simulation.packets import decode_status as decode_status

if TYPE_CHECKING:
    from typing import Self


class InstructionPacket(Packet):
    """What the master sends in protocol 1.0."""

    PROTOCOL: ClassVar = 1

    def encode(self) -> bytes:
        return encode(self.PROTOCOL, self)

    @classmethod
    def words(cls, *values: int) -> bytes:
        """Addresses and lengths, as wide as the protocol has them."""
        return b"".join(value.to_bytes(cls.PROTOCOL, "little") for value in values)

    @classmethod
    def ping(cls, servo_id: int = BROADCAST) -> Self:
        return cls(servo_id, Instruction.PING)

    @classmethod
    def read(cls, servo_id: int, address: int, length: int) -> Self:
        return cls(servo_id, Instruction.READ, cls.words(address, length))

    @classmethod
    def write(cls, servo_id: int, address: int, data: bytes) -> Self:
        return cls(servo_id, Instruction.WRITE, cls.words(address) + data)


class InstructionPacket2(InstructionPacket):
    """What the master sends in protocol 2.0."""

    PROTOCOL: ClassVar = 2

    @classmethod
    def sync_read(cls, address: int, length: int, ids: Sequence[int]) -> Self:
        return cls(BROADCAST, Instruction.SYNC_READ, cls.words(address, length) + bytes(ids))


def write(servo: SimulatedServo, name: str, value: int, now: int = 0) -> int:
    """Write a register by a packet; return the error byte of the answer."""
    register = servo_model(servo.model.name).control_table[name]
    packet = InstructionPacket if servo.model.protocol == 1 else InstructionPacket2
    data = value.to_bytes(register.size, "little", signed=value < 0)
    status = servo.execute(packet.write(servo.id, register.address, data), now)
    assert status is not None
    return status.error
