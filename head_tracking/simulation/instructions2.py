"""What a servo with protocol 2.0 does about a packet."""

from __future__ import annotations

from typing import Final

from head_tracking.dynamixel.protocol import (
    ALERT,
    BROADCAST_ID,
    CLEAR_MULTI_TURN,
    Instruction,
    StatusCode,
)
from head_tracking.simulation.memory import Refusal
from head_tracking.simulation.protocol2 import (
    DamagedPacket2,
    InstructionPacket2,
    StatusPacket2,
)
from head_tracking.simulation.servo_body import ServoBody

_ALL, _BUT_ID, _BUT_ID_AND_BAUD_RATE = 0xFF, 0x01, 0x02
_OK: Final = (StatusCode.OK, b"")


class Protocol2:
    """The instructions of protocol 2.0, carried out on a servo."""

    ERRORS: Final = {
        None: StatusCode.OK,
        Refusal.RESERVED: StatusCode.ACCESS,
        Refusal.READ_ONLY: StatusCode.ACCESS,
        Refusal.LOCKED: StatusCode.ACCESS,
        Refusal.LENGTH: StatusCode.DATA_LENGTH,
        Refusal.RANGE: StatusCode.DATA_RANGE,
        Refusal.LIMIT: StatusCode.DATA_LIMIT,
    }

    def execute(self, servo: ServoBody, packet: InstructionPacket2) -> StatusPacket2 | None:
        """Carry out a packet for this servo; return its answer, if it gives one."""
        servo_id = servo.id  # the answer to a change of the id still carries the old one
        silent = packet.id != servo_id
        if silent and packet.instruction in (Instruction.READ, Instruction.PING):
            return None  # a ping of all is the bus's business: their order matters
        answers = self._answers(servo, packet.instruction)
        code, data = self._dispatch(servo, packet)
        if silent or not (answers and self._answers(servo, packet.instruction)):
            return None
        return StatusPacket2(servo_id, code | self.alert(servo), data)

    def complain(self, servo: ServoBody, packet: DamagedPacket2) -> StatusPacket2 | None:
        """Return the answer to a packet with a wrong CRC."""
        if servo.status_return_level < 2:
            return None
        return StatusPacket2(servo.id, StatusCode.CRC | self.alert(servo))

    def ping(self, servo: ServoBody) -> StatusPacket2:
        """Return the answer to a ping: Model Number and firmware."""
        model = servo.register("Model Number").to_bytes(2, "little")
        firmware = bytes((servo.register("Firmware Version"),))
        return StatusPacket2(servo.id, self.alert(servo), model + firmware)

    def read(self, servo: ServoBody, address: int, length: int) -> StatusPacket2:
        """Return the answer to a read, also to one that is part of a sync or bulk read."""
        data = servo.read(address, length)
        if data is None:
            return StatusPacket2(servo.id, StatusCode.ACCESS | self.alert(servo))
        return StatusPacket2(servo.id, self.alert(servo), data)

    def alert(self, servo: ServoBody) -> int:
        """Return the alert bit if there is a hardware error, else 0."""
        return ALERT if servo.alarms.active else 0

    def _answers(self, servo: ServoBody, instruction: int) -> bool:
        if instruction == Instruction.PING:
            return True
        return servo.status_return_level >= (1 if instruction == Instruction.READ else 2)

    def _dispatch(self, servo: ServoBody, packet: InstructionPacket2) -> tuple[StatusCode, bytes]:
        parameters = packet.parameters
        match packet.instruction:
            case Instruction.PING:
                return StatusCode.OK, self.ping(servo).data
            case Instruction.READ:
                if len(parameters) != 4:
                    return StatusCode.DATA_LENGTH, b""
                data = servo.read(*_place(parameters))
                return (StatusCode.ACCESS, b"") if data is None else (StatusCode.OK, data)
            case Instruction.WRITE | Instruction.REG_WRITE:
                if len(parameters) < 3:
                    return StatusCode.DATA_LENGTH, b""
                take = servo.write if packet.instruction == Instruction.WRITE else servo.keep
                address = int.from_bytes(parameters[:2], "little")
                return self.ERRORS[take(address, parameters[2:])], b""
            case Instruction.ACTION:
                return (StatusCode.OK if servo.act() else StatusCode.INSTRUCTION), b""
            case Instruction.FACTORY_RESET:
                return self._reset(servo, packet), b""
            case Instruction.REBOOT:
                servo.reboot()
                return _OK
            case Instruction.CLEAR:
                if parameters != CLEAR_MULTI_TURN:
                    return StatusCode.DATA_RANGE, b""
                return (StatusCode.OK if servo.clear_turns() else StatusCode.RESULT_FAIL), b""
            case Instruction.SYNC_WRITE | Instruction.BULK_WRITE if packet.id == BROADCAST_ID:
                bulk = packet.instruction == Instruction.BULK_WRITE
                share = packet.bulk_share(servo.id) if bulk else packet.sync_share(servo.id)
                if share is not None:
                    servo.write(*share)
                return _OK
        return StatusCode.INSTRUCTION, b""

    def _reset(self, servo: ServoBody, packet: InstructionPacket2) -> StatusCode:
        if packet.parameters == bytes((_ALL,)):
            if packet.id == BROADCAST_ID:
                return StatusCode.RESULT_FAIL  # newer firmware ignores it, so that ids stay apart
            servo.reset()
        elif packet.parameters == bytes((_BUT_ID,)):
            servo.reset("ID")
        elif packet.parameters == bytes((_BUT_ID_AND_BAUD_RATE,)):
            servo.reset("ID", "Baud Rate")
        else:
            return StatusCode.DATA_RANGE
        return StatusCode.OK


def _place(parameters: bytes) -> tuple[int, int]:
    return int.from_bytes(parameters[:2], "little"), int.from_bytes(parameters[2:4], "little")
