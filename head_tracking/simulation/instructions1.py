"""What a servo with protocol 1.0 does about a packet."""

from __future__ import annotations

from typing import Final

from head_tracking.dynamixel.protocol import BROADCAST_ID, NO_ERROR, ErrorBits, Instruction
from head_tracking.simulation.memory import Refusal
from head_tracking.simulation.protocol1 import DamagedPacket, InstructionPacket, StatusPacket
from head_tracking.simulation.servo_body import ServoBody


class Protocol1:
    """The instructions of protocol 1.0, carried out on a servo."""

    ERRORS: Final = {Refusal.LIMIT: ErrorBits.ANGLE_LIMIT, None: NO_ERROR}
    """Error bits of a refusal; those that are not here are RANGE."""

    def execute(self, servo: ServoBody, packet: InstructionPacket) -> StatusPacket | None:
        """Carry out a packet for this servo; return its answer, if it gives one."""
        servo_id = servo.id  # the answer to a change of the id still carries the old one
        broadcast = packet.id == BROADCAST_ID
        answers = self._answers(servo, packet.instruction)
        error, data = self._dispatch(servo, packet, broadcast)
        if broadcast or not (answers and self._answers(servo, packet.instruction)):
            return None
        state = self.state(servo)
        return StatusPacket(servo_id, error | state if error and state else error or state, data)

    def complain(self, servo: ServoBody, packet: DamagedPacket) -> StatusPacket | None:
        """Return the answer to a packet with a wrong checksum."""
        if servo.status_return_level < 2:
            return None
        return StatusPacket(servo.id, ErrorBits.CHECKSUM | self.state(servo))

    def read(self, servo: ServoBody, address: int, length: int) -> StatusPacket:
        """Return the answer to a read, also to one that is part of a bulk read."""
        data = servo.read(address, length)
        if data is None:
            return StatusPacket(servo.id, ErrorBits.RANGE | self.state(servo))
        return StatusPacket(servo.id, self.state(servo), data)

    def state(self, servo: ServoBody) -> ErrorBits:
        """Return the bits that every answer carries."""
        active = servo.alarms.active
        return ErrorBits(active) if active else NO_ERROR

    def _answers(self, servo: ServoBody, instruction: int) -> bool:
        if instruction == Instruction.PING:
            return True
        return servo.status_return_level >= (1 if instruction == Instruction.READ else 2)

    def _dispatch(
        self, servo: ServoBody, packet: InstructionPacket, broadcast: bool
    ) -> tuple[ErrorBits, bytes]:
        parameters = packet.parameters
        match packet.instruction:
            case Instruction.PING:
                return NO_ERROR, b""
            case Instruction.READ if len(parameters) == 2 and not broadcast:
                status = self.read(servo, *parameters)
                return status.error, status.data
            case Instruction.WRITE if parameters:
                return self._error(servo.write(parameters[0], parameters[1:])), b""
            case Instruction.REG_WRITE if parameters:
                return self._error(servo.keep(parameters[0], parameters[1:])), b""
            case Instruction.ACTION:
                return (NO_ERROR if servo.act() else ErrorBits.INSTRUCTION), b""
            case Instruction.FACTORY_RESET:
                servo.reset()
                return NO_ERROR, b""
            case Instruction.SYNC_WRITE if broadcast:
                share = packet.sync_write_share(servo.id)
                return NO_ERROR if share is None else self._error(servo.write(*share)), b""
        return ErrorBits.INSTRUCTION, b""

    def _error(self, refusal: Refusal | None) -> ErrorBits:
        return self.ERRORS.get(refusal, ErrorBits.RANGE)
