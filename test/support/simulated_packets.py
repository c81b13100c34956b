"""How simulated servos answer what the driver sends."""

from head_tracking.dynamixel import servo_model
from head_tracking.dynamixel.protocol import write_packet
from head_tracking.simulation import SimulatedServo
from head_tracking.simulation.packets import Status, decode


def answer(servo: SimulatedServo, packet: bytes, now: int = 0) -> Status:
    """Return what a servo answers to an instruction."""
    instruction = decode(servo.model.protocol, packet)
    assert instruction is not None
    status = servo.execute(instruction, now)
    assert status is not None
    return status


def write(servo: SimulatedServo, name: str, value: int, now: int = 0) -> int:
    """Write a register; return the error byte of the answer."""
    register = servo_model(servo.model.name).control_table[name]
    data = value.to_bytes(register.size, "little", signed=value < 0)
    packet = write_packet(servo.model.protocol, servo.id, register.address, data)
    return answer(servo, packet, now).error
